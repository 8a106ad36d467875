// SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// The search of heightmap25d_ros/planner.py in C: the same cells in the same order, out of the
// same buckets, so that the costs come out the same. benchmarks/c_planner.py compiles it and
// calls it by ctypes.
#include <stdint.h>
#include <stdlib.h>

#define STRAIGHT 70
#define DIAGONAL 99
#define CLOSED 0
#define WIDTH_BITS 5
#define RING 256
#define CHUNK 32

static const int NEIGHBOURS[8][2] = {{0, 1},  {1, 1},   {1, 0},  {1, -1},
                                     {0, -1}, {-1, -1}, {-1, 0}, {-1, 1}};

static inline int64_t estimate(int64_t dy, int64_t dx) {
  dy = llabs(dy);
  dx = llabs(dx);
  int64_t more = dy > dx ? dy : dx, less = dy > dx ? dx : dy;
  return STRAIGHT * more + (DIAGONAL - STRAIGHT) * less;
}

// Until the queue is empty or the start's cost is known. The goal waits in bucket 0 already.
void search(const uint16_t *incoming, int32_t *remaining, int64_t columns, int32_t *tops,
            int64_t *entries, int64_t offset, int64_t start_y, int64_t start_x) {
  const int64_t ways[8] = {1,  columns + 1,  columns,  columns - 1,
                           -1, -columns - 1, -columns, 1 - columns};
  int64_t bucket = 0, unused = 2 * CHUNK, free_chunk = 0;
  int is_guided = start_y != 0;
  int64_t start = start_y * columns + start_x;
  for (;;) {
    int64_t last = bucket + RING;
    while (tops[bucket & (RING - 1)] == 0) {
      bucket++;
      if (bucket == last) return;
    }
    int64_t slot = bucket & (RING - 1), top = tops[slot], entry = entries[top];
    top--;
    if ((top & (CHUNK - 1)) == 0) {
      int64_t below = entries[top];
      entries[top] = free_chunk;
      free_chunk = top;
      top = below;
    }
    tops[slot] = (int32_t)top;
    int64_t packed = entry >> 32, cost = (int32_t)entry;
    int64_t y = packed >> 16, x = packed & 0xFFFF, cell = y * columns + x;
    if (remaining[cell] != cost) continue;
    if (is_guided && remaining[start] != 0) {
      if ((remaining[start] + offset) >> WIDTH_BITS < bucket) return;
      if (cost + estimate(y - start_y, x - start_x) >= remaining[start]) continue;
    }
    unsigned shorter = 0;
    for (int k = 0; k < 8; k++) {
      int64_t step = incoming[8 * cell + k];
      shorter |= (unsigned)((step != CLOSED) & (cost + step < remaining[cell + ways[k]])) << k;
    }
    while (shorter != 0) {
      int k = __builtin_ctz(shorter);
      shorter &= shorter - 1;
      int64_t there = cell + ways[k], left = cost + incoming[8 * cell + k];
      remaining[there] = (int32_t)left;
      __builtin_prefetch(incoming + 8 * there);
      __builtin_prefetch(remaining + there + ways[k]);
      int64_t dy = NEIGHBOURS[k][0], dx = NEIGHBOURS[k][1], place = left + offset;
      if (is_guided) place += estimate(y + dy - start_y, x + dx - start_x);
      slot = (place >> WIDTH_BITS) & (RING - 1);
      top = tops[slot];
      int64_t new = top + 1;
      if (((new & (CHUNK - 1)) == 0) | (top == 0)) {
        int64_t chunk = free_chunk;
        if (chunk != 0) {
          free_chunk = entries[chunk];
        } else {
          chunk = unused;
          unused += CHUNK;
        }
        entries[chunk] = top;
        new = chunk + 1;
      }
      entries[new] = (int64_t)((uint64_t)(packed + dy * 65536 + dx) << 32 | (uint32_t)left);
      tops[slot] = (int32_t)new;
    }
  }
}
