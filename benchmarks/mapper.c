// SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// The traversal and the rules of heightmap25d_ros/mapper.py in C: the same cells in the same
// order with the same arithmetic, so that the arrays come out bit for bit the same.
// benchmarks/mapping.py compiles it (-O3, without fused multiply-add) and calls it by ctypes.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#define TILE 16
#define CELLS (TILE * TILE)
#define TOP_BIAS 32768
#define HEIGHT_LIMIT 32700
#define HEIGHT_RESOLUTION 0.01
#define PROBABILITY_SCALE 65535
#define OBSERVED 1
#define TICKS 0x1p40
#define FEW 1024
#define ENDLESS 0x1p57
#define HEIGHT_STEP 1.0
#define LEVEL 0.25
#define END 1.0
#define GOLDEN 2654435761
#define PROBES 16

typedef struct {
  double object_near, object_far, empty_near, empty_far, max_range;
} Likelihoods;

typedef struct {
  int64_t candidate, tolerance, allowance, known, lowest, highest, candidate_belief;
  double clearing_margin, clearing_fall, clearing_width, replace_belief;
} Rule;

typedef struct {
  int64_t tile_rows, tile_columns;
  double corner_x, corner_y, ground_zero, cells_per_metre;
  int16_t *heights;
  uint16_t *probabilities;
  int16_t *candidate_heights;
  uint16_t *candidates;
  uint16_t *tile_top;
  uint8_t *tile_changed;
  int64_t *observed, *changed;  // first row and column, last row and column, number of tiles
} Grid;

typedef struct {
  int64_t height, probability, candidate_height, candidate;
} Cell;

typedef struct {
  int64_t *cells;
  int64_t mask;
} Judged;

typedef struct {
  double origin;
  int64_t step, side;
  double cells, ticks;
} Axis;

static inline int64_t min_i(int64_t a, int64_t b) { return a < b ? a : b; }
static inline int64_t max_i(int64_t a, int64_t b) { return a > b ? a : b; }
static inline double min_d(double a, double b) { return a < b ? a : b; }
static inline double max_d(double a, double b) { return a > b ? a : b; }
static inline int64_t floor_i(double value) { return (int64_t)floor(value); }

static inline void likelihoods(double distance, const Likelihoods *model, double *object,
                               double *empty) {
  double far = min_d(distance / model->max_range, 1.0);
  *object = model->object_near + far * (model->object_far - model->object_near);
  *empty = model->empty_near + far * (model->empty_far - model->empty_near);
}

static inline int64_t stored(double probability, const Rule *rule) {
  int64_t value = (int64_t)(probability * PROBABILITY_SCALE + 0.5);
  return min_i(max_i(value, rule->lowest), rule->highest);
}

static inline int64_t bayes(int64_t before, double object, double empty, const Rule *rule) {
  double for_object = object * (double)before;
  double for_empty = empty * (double)(PROBABILITY_SCALE - before);
  return stored(for_object / (for_object + for_empty), rule);
}

static Cell propose(Cell cell, int64_t z, double object, double empty, const Rule *rule) {
  if (cell.candidate == 0) {
    return (Cell){cell.height, cell.probability, z, stored(object, rule)};
  }
  int64_t lower = min_i(z, cell.candidate_height), higher = max_i(z, cell.candidate_height);
  int is_same = higher - lower <= rule->tolerance;
  int64_t supported = is_same ? higher : lower;
  int64_t belief = bayes(cell.candidate, object, empty, rule);
  if (belief < rule->candidate_belief) {
    return (Cell){cell.height, cell.probability, supported, belief};
  }
  return (Cell){supported, belief, higher, is_same ? 0 : stored(object, rule)};
}

static inline Cell hit(Cell cell, int64_t z, double distance, const Likelihoods *model,
                       const Rule *rule) {
  double object, empty;
  likelihoods(distance, model, &object, &empty);
  if (cell.probability < rule->known) return (Cell){z, stored(object, rule), 0, 0};
  if (z > cell.height + rule->tolerance) {
    if (object < rule->replace_belief) return cell;
    if (rule->candidate) return propose(cell, z, object, empty, rule);
    return (Cell){z, stored(object, rule), 0, 0};
  }
  if (z >= cell.height - rule->tolerance) {
    cell.probability = bayes(cell.probability, object, empty, rule);
    cell.height = max_i(z - rule->allowance, cell.height);
    if (cell.candidate_height <= cell.height + rule->tolerance) cell.candidate = 0;
  }
  return cell;
}

static inline Cell miss(Cell cell, double beam_height, double distance, const Likelihoods *model,
                        const Rule *rule) {
  double object, empty;
  likelihoods(distance, model, &object, &empty);
  if (cell.candidate > 0 && (double)cell.candidate_height >= beam_height) {
    cell.candidate = bayes(cell.candidate, object, empty, rule);
    if (cell.candidate < rule->known) cell.candidate = 0;
  }
  if (cell.probability >= rule->known && (double)cell.height >= beam_height) {
    cell.probability = bayes(cell.probability, object, empty, rule);
  }
  return cell;
}

static inline Axis axis(double origin, double end) {
  double extent = end - origin, ticks = min_d(TICKS / fabs(extent), ENDLESS);
  if (extent < 0.0) return (Axis){origin, -1, 0, extent / TICKS, -ticks};
  return (Axis){origin, 1, 1, extent / TICKS, ticks};
}

static inline int64_t exit_of(double index, int64_t size, Axis axis) {
  return (int64_t)(((index + (double)axis.side) * (double)size - axis.origin) * axis.ticks);
}

static inline int64_t across_of(int64_t size, Axis axis) {
  return (int64_t)(fabs(axis.ticks) * (double)size);
}

static inline int64_t entry_of(double index, Axis axis) {
  return exit_of(index, 1, axis) - across_of(1, axis);
}

static inline int add(int64_t cell, Judged judged) {
  int64_t slot = (int64_t)(((uint64_t)cell * GOLDEN) >> 20) & judged.mask;
  for (int probe = 0; probe < PROBES; probe++) {
    if (judged.cells[slot] == cell) return 0;
    if (judged.cells[slot] == -1) {
      judged.cells[slot] = cell;
      return 1;
    }
    slot = (slot + 1) & judged.mask;
  }
  return 0;
}

static inline int may_judge(int64_t index, double middle, Axis x, Axis y, Judged judged,
                            const Rule *rule) {
  double off_x = (double)(int64_t)(x.origin + middle * x.cells) + 0.5 - x.origin;
  double off_y = (double)(int64_t)(y.origin + middle * y.cells) + 0.5 - y.origin;
  double across = off_x * y.cells - off_y * x.cells;
  double width = rule->clearing_width;
  if (across * across > width * width * (x.cells * x.cells + y.cells * y.cells)) return 0;
  return add(index, judged);
}

static inline Cell cell_of(const Grid *grid, int64_t index) {
  return (Cell){grid->heights[index], grid->probabilities[index], grid->candidate_heights[index],
                grid->candidates[index]};
}

static int64_t top_of(const Grid *grid, int64_t first, const Rule *rule) {
  int64_t top = OBSERVED;
  for (int64_t index = first; index < first + CELLS; index++) {
    if (grid->probabilities[index] >= rule->known) {
      top = max_i(top, grid->heights[index] + TOP_BIAS);
    }
    if (grid->candidates[index] > 0) top = max_i(top, grid->candidate_heights[index] + TOP_BIAS);
  }
  return top;
}

static inline int is_contradicted(Cell cell, double beam_height, const Rule *rule) {
  int stands = (double)cell.height >= beam_height && cell.probability >= rule->known;
  return stands || (cell.candidate > 0 && (double)cell.candidate_height >= beam_height);
}

static inline int clear_tile(const Grid *grid, int64_t tile, int64_t start, int64_t stop, Axis x,
                             Axis y, double z, double fall, double distance, double metres,
                             double lacking, double end, Judged judged, const Likelihoods *model, const Rule *rule) {
  int is_lost = 0;
  double half_fall = 0.5 * fall;
  double ix = floor(x.origin + (double)(start + FEW) * x.cells);
  double iy = floor(y.origin + (double)(start + FEW) * y.cells);
  int64_t exit_x = exit_of(ix, 1, x), exit_y = exit_of(iy, 1, y);
  int64_t across_x = across_of(1, x), across_y = across_of(1, y);
  int64_t entered = max_i(exit_x - across_x, exit_y - across_y);
  int64_t index = tile * CELLS + ((int64_t)iy & (TILE - 1)) * TILE + ((int64_t)ix & (TILE - 1));
  while (entered < stop - FEW) {
    int64_t left = min_i(exit_x, exit_y);
    double middle = 0.5 * (double)(entered + left);
    double beam_height = z - (double)(entered + left) * half_fall;
    if (distance + middle * metres > end) beam_height += lacking;
    if ((grid->heights[index] >= beam_height || grid->candidates[index] > 0) &&
        left - entered > FEW) {
      Cell before = cell_of(grid, index);
      if (is_contradicted(before, beam_height, rule) &&
          (!rule->candidate || may_judge(index, middle, x, y, judged, rule))) {
        Cell after = miss(before, beam_height, distance + middle * metres, model, rule);
        grid->probabilities[index] = (uint16_t)after.probability;
        if (before.candidate) grid->candidates[index] = (uint16_t)after.candidate;
        is_lost |= after.probability < rule->known && rule->known <= before.probability;
      }
    }
    entered = left;
    if (exit_x < exit_y) {
      index += x.step;
      exit_x += across_x;
    } else {
      index += y.step * TILE;
      exit_y += across_y;
    }
  }
  return is_lost;
}

static inline double margin(double fall, const Rule *rule) {
  if (fall >= rule->clearing_fall) return rule->clearing_margin;
  double share = fall / rule->clearing_fall;
  return share * rule->clearing_margin - (1.0 - share) * HEIGHT_STEP;
}

static inline void include(int64_t ty, int64_t tx, int64_t *bounds) {
  bounds[0] = min_i(bounds[0], ty);
  bounds[1] = min_i(bounds[1], tx);
  bounds[2] = max_i(bounds[2], ty);
  bounds[3] = max_i(bounds[3], tx);
  bounds[4]++;
}

static inline void clear(const Grid *grid, const double *origin, const double *end, double length,
                         Judged judged, const Likelihoods *model, const Rule *rule) {
  int rises = origin[2] < end[2];
  const double *upper = rises ? end : origin, *lower = rises ? origin : end;
  double distance = rises ? length : 0.0, metres = (rises ? -length : length) / TICKS;
  Axis x = axis(upper[0], lower[0]), y = axis(upper[1], lower[1]);
  int64_t first = min_i(exit_of(floor(upper[0]), 1, x), exit_of(floor(upper[1]), 1, y));
  int64_t last = max_i(entry_of(floor(lower[0]), x), entry_of(floor(lower[1]), y)) - FEW;
  double fall = upper[2] - lower[2];
  double applied = margin(fall, rule), z = upper[2] + applied;
  double lacking = rule->clearing_margin - applied;
  double ticks_per_cm = TICKS / max_d(fall, LEVEL), biased_z = z + TOP_BIAS;
  int64_t tx = (int64_t)upper[0] / TILE, ty = (int64_t)upper[1] / TILE;
  int64_t tile = ty * grid->tile_columns + tx;
  int64_t exit_x = exit_of((double)tx, TILE, x), exit_y = exit_of((double)ty, TILE, y);
  int64_t across_x = across_of(TILE, x), across_y = across_of(TILE, y);
  int64_t last_tx = (int64_t)lower[0] / TILE, last_ty = (int64_t)lower[1] / TILE;
  for (int64_t left = 1 + llabs(last_tx - tx) + llabs(last_ty - ty); left > 0; left--) {
    int64_t stop = min_i(min_i(exit_x, exit_y), last);
    int64_t meets = (int64_t)((biased_z - grid->tile_top[tile]) * ticks_per_cm);
    if (meets < stop) {
      int64_t start = max_i(max_i(first, meets), max_i(exit_x - across_x, exit_y - across_y));
      if (clear_tile(grid, tile, start, stop, x, y, z, fall / TICKS, distance, metres, lacking,
                     length - END, judged,
                     model, rule)) {
        if (!grid->tile_changed[tile]) {
          grid->tile_changed[tile] = 1;
          include(tile / grid->tile_columns, tile % grid->tile_columns, grid->changed);
        }
        grid->tile_top[tile] = (uint16_t)top_of(grid, tile * CELLS, rule);
      }
    }
    if (exit_x < exit_y) {
      tile += x.step;
      exit_x += across_x;
    } else {
      tile += y.step * grid->tile_columns;
      exit_y += across_y;
    }
  }
}

static inline void in_cells(const Grid *grid, const double *point, double *cells) {
  cells[0] = (point[0] - grid->corner_x) * grid->cells_per_metre;
  cells[1] = (point[1] - grid->corner_y) * grid->cells_per_metre;
  cells[2] = (point[2] - grid->ground_zero) * (1.0 / HEIGHT_RESOLUTION);
}

static inline int is_inside(const Grid *grid, const double *point) {
  return 0.0 <= point[0] && point[0] < (double)(grid->tile_columns * TILE) && 0.0 <= point[1] &&
         point[1] < (double)(grid->tile_rows * TILE);
}

static Judged cells_hit(const double *ends, const uint8_t *is_hit, const uint8_t *is_lone,
                        int64_t count, const Grid *grid, const Rule *rule) {
  int64_t size = 16;
  while (size < 4 * count) size *= 2;
  if (!rule->candidate) size = 1;
  Judged judged = {malloc((size_t)size * sizeof(int64_t)), size - 1};
  for (int64_t slot = 0; slot < size; slot++) judged.cells[slot] = -1;
  for (int64_t beam = 0; rule->candidate && beam < count; beam++) {
    if (!is_hit[beam] || is_lone[beam]) continue;
    double end[3];
    in_cells(grid, ends + 3 * beam, end);
    int64_t ix = floor_i(end[0]), iy = floor_i(end[1]);
    int64_t tile = (iy >> 4) * grid->tile_columns + (ix >> 4);
    add(tile * CELLS + (iy & (TILE - 1)) * TILE + (ix & (TILE - 1)), judged);
  }
  return judged;
}

void integrate(const double *origins, const double *ends, const uint8_t *is_hit,
               const uint8_t *is_lone, int64_t count, const Grid *grid,
               const Likelihoods *hit_model, const Likelihoods *miss_model, const Rule *rule,
               int64_t *counts) {
  Judged judged = cells_hit(ends, is_hit, is_lone, count, grid, rule);
  for (int64_t beam = 0; beam < count; beam++) {
    if (rule->candidate && is_lone[beam]) continue;
    const double *from = origins + 3 * beam, *to = ends + 3 * beam;
    double origin[3], end[3];
    in_cells(grid, from, origin);
    in_cells(grid, to, end);
    if (!is_inside(grid, origin) || !is_inside(grid, end)) {
      counts[2] += is_hit[beam];
      continue;
    }
    double dx = to[0] - from[0], dy = to[1] - from[1], dz = to[2] - from[2];
    double length = sqrt(dx * dx + dy * dy + dz * dz);
    clear(grid, origin, end, length, judged, miss_model, rule);
    if (!is_hit[beam]) continue;
    int64_t ix = (int64_t)end[0], iy = (int64_t)end[1];
    int64_t z = floor_i(end[2] + 0.5);
    if (llabs(z) > HEIGHT_LIMIT) {
      counts[1]++;
      continue;
    }
    int64_t tile = iy / TILE * grid->tile_columns + ix / TILE;
    int64_t index = tile * CELLS + iy % TILE * TILE + ix % TILE;
    Cell before = cell_of(grid, index);
    Cell after = hit(before, z, length, hit_model, rule);
    grid->heights[index] = (int16_t)after.height;
    grid->probabilities[index] = (uint16_t)after.probability;
    if (after.candidate || before.candidate) {
      grid->candidate_heights[index] = (int16_t)after.candidate_height;
      grid->candidates[index] = (uint16_t)after.candidate;
    }
    int changes = after.height != before.height || before.probability < rule->known;
    if (changes && !grid->tile_changed[tile]) {
      grid->tile_changed[tile] = 1;
      include(iy / TILE, ix / TILE, grid->changed);
    }
    if (!grid->tile_top[tile]) include(iy / TILE, ix / TILE, grid->observed);
    int64_t top = max_i(after.height, z) + TOP_BIAS;
    grid->tile_top[tile] = (uint16_t)max_i(grid->tile_top[tile], top);
    counts[0]++;
  }
  free(judged.cells);
}
