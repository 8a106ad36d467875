# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/defaults.md: the default rule beside the literal one, and its parts.

Usage: python studies/measure_defaults.py [--bags DIR] [--pictures DIR]

Simulated drives with true poses, three of each world. With --bags, recordings that are in
DIR/WORLD_SEED are taken and the others made there; without, all are made anew and thrown away.
With --pictures, docs/defaults_*.png are drawn too. Markdown to the terminal.
"""

import argparse
import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import defaults_pictures
import numpy as np
import yaml
from numpy.typing import NDArray

from heightmap25d_ros import cli
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals
from heightmap25d_ros.evaluation.map_error import evaluate_map
from heightmap25d_ros.evaluation.truth import read_goals, read_truth
from heightmap25d_ros.grid.height_map import Area, Geometry
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.terrain.traversability import to_obstacle_map

WORLDS = ("ramp", "room", "rough", "street", "moving")
SEEDS = (1, 2, 3)
RULES = ("paper", "candidate")
PARTS = {  # of the default, each turned off alone
    "`lone_return: 0`": {"lone_return": 0.0},
    "`clearing_width: 3`": {"clearing_width": 3.0},
    "`clearing_margin: 0`": {"clearing_margin": 0.0},
    "`height_allowance: 0`": {"height_allowance": 0.0},
}
TARGETS = {  # of the issue; goals as shares
    "F1": (">=", 0.98),
    "precision": (">=", 0.98),
    "recall": (">=", 0.97),
    "coverage": (">=", 0.95),
    "tops off by > 10 cm": ("<=", 0.005),
    "95 % of height errors [cm]": ("<=", 2.5),
    "goals found": (">=", 0.95),
    "unreachable refused": (">=", 1.0),
}
BOX_HEIGHT = 0.5  # [m] of the box that is taken away in `moving`
PHANTOM = 0.10  # [m] above the ground
EPOCH_NS = 10**18  # stamp at which a simulated drive begins
SAMPLES = 100  # of a beam within the box's place


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="where the pictures go to")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        bags, maps = options.bags or Path(scratch, "bags"), Path(scratch, "maps")
        bags.mkdir(parents=True, exist_ok=True)
        record(bags)
        print("\n".join(comparison(bags, maps)), end="\n\n")
        print("\n".join(ablation(bags, maps)), end="\n\n")
        print("\n".join(ceilings(bags)), end="\n\n")
        print("\n".join(removals(bags)))
        if options.pictures:
            defaults_pictures.draw(bags, maps, options.pictures)
    return 0


def record(bags: Path) -> None:
    for world in WORLDS:
        for seed in SEEDS:
            if not (bags / f"{world}_{seed}").exists():
                run("simulate", world, "--seed", seed, "--true-odometry",
                    "-o", bags / f"{world}_{seed}")  # fmt: skip


def run(*arguments: object) -> dict:
    """What `heightmap25d ... --json` prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        status = cli.main([str(argument) for argument in (*arguments, "--json")])
    if status:
        sys.exit(status)
    figures: dict = json.loads(printed.getvalue())
    return figures


def measure(bag: Path, output: Path, *options: object) -> dict[str, float]:
    """Map a bag and hold it against its truth."""
    run("map", bag, "-o", output, *options)
    figures = run("evaluate", output, "--truth", bag / "truth" / "surface.npz")
    blocked, error, goals = (
        figures[key] for key in ("blocked_transitions", "error_of_seen", "goals")
    )
    return {
        "F1": blocked["f1"],
        "precision": blocked["precision"],
        "recall": blocked["recall"],
        "coverage": figures["coverage"],
        "tops off by > 10 cm": error["share_beyond_10_cm"],
        "95 % of height errors [cm]": 100 * error["percentile_95_absolute_m"],
        "goals found": np.array([goals["found"], goals["observed_goals"]]),
        "unreachable refused": np.array([goals["refused"], goals["unreachable_goals"]]),
    }


def worst(name: str, values: list) -> float | NDArray[np.int64]:
    """Of several seeds; goals are summed."""
    if isinstance(values[0], np.ndarray):
        return np.sum(values, axis=0)
    return min(values) if TARGETS[name][0] == ">=" else max(values)


def text(name: str, value: float | NDArray[np.int64]) -> str:
    if isinstance(value, np.ndarray):
        return f"{value[0]} of {value[1]}"
    if name.startswith("tops"):
        return f"{100 * value:.1f} %"
    return f"{value:.1f}" if name.endswith("[cm]") else f"{value:.3f}"


def is_met(name: str, value: float | NDArray[np.int64]) -> bool:
    relation, target = TARGETS[name]
    share = value[0] / value[1] if isinstance(value, np.ndarray) else value
    return bool(share >= target if relation == ">=" else share <= target)


def comparison(bags: Path, maps: Path) -> Iterator[str]:
    """The literal rule -> the default, the worst of the seeds."""
    yield f"| world | {' | '.join(TARGETS)} |"
    yield "|---" * (len(TARGETS) + 1) + "|"
    missed: dict[str, list[str]] = {name: [] for name in TARGETS}
    for world in WORLDS:
        drives = [f"{world}_{seed}" for seed in SEEDS]
        literal, default = (
            [measure(bags / d, maps / f"{d}_{rule}", "--update-rule", rule) for d in drives]
            for rule in RULES
        )
        cells = []
        for name in TARGETS:
            before, after = (worst(name, [m[name] for m in rule]) for rule in (literal, default))
            cells.append(f"{text(name, before)} -> {text(name, after)}")
            if not is_met(name, after):
                missed[name].append(f"`{world}`")
        yield f"| `{world}` | {' | '.join(cells)} |"
    yield f"| target | {' | '.join(target_text(name) for name in TARGETS)} |"
    verdicts = (f"no: {', '.join(worlds)}" if worlds else "yes" for worlds in missed.values())
    yield f"| met by the default | {' | '.join(verdicts)} |"


def target_text(name: str) -> str:
    relation, target = TARGETS[name]
    sign = {">=": "at least", "<=": "at most"}[relation]
    if name.endswith("[cm]"):
        return f"{sign} {target}"
    percent = name.startswith("tops") or name in ("goals found", "unreachable refused")
    return f"{sign} {100 * target:g} %" if percent else f"{sign} {target:.2f}"


def ablation(bags: Path, maps: Path) -> Iterator[str]:
    """The default without one of its parts, the worst of the seeds of three figures."""
    shown = ("F1", "coverage", "tops off by > 10 cm")
    yield f"| {', '.join(shown)} | {' | '.join(f'`{world}`' for world in WORLDS)} |"
    yield "|---" * (len(WORLDS) + 1) + "|"
    maps.mkdir(parents=True, exist_ok=True)
    for label, values in {"default": {}, **PARTS}.items():
        file = maps / "without.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"mapper": values}}}))
        cells = []
        for world in WORLDS:
            figures = [
                measure(bags / f"{world}_{seed}", maps / "without", "--params", file)
                for seed in SEEDS
            ]
            cells.append(", ".join(text(n, worst(n, [f[n] for f in figures])) for n in shown))
        yield f"| {label} | {' | '.join(cells)} |"


def ceilings(bags: Path) -> Iterator[str]:
    """What a map would score that holds just what the lasers met, or the true surface."""
    yield "| world | F1 | precision | recall | unreachable refused on the true surface |"
    yield "|---" * 5 + "|"
    for world in WORLDS:
        rows = []
        for seed in SEEDS:
            directory = bags / f"{world}_{seed}" / "truth"
            truth = read_truth(directory / "surface.npz")
            pairs = read_goals(directory / "goals.npz")
            met, all_of_it = (
                defaults_pictures.exact(truth.geometry, z) for z in (truth.seen, truth.top)
            )
            figures = evaluate_map(met, Params().traversability, truth)
            obstacles = to_obstacle_map(all_of_it, Params().traversability)
            refused = evaluate_goals(obstacles, pairs)
            blocked = figures.blocked_transitions
            rows.append((blocked.f1, blocked.precision, blocked.recall, refused))
        scores = " | ".join(f"{min(row[i] for row in rows):.3f}" for i in range(3))
        refused_of = [
            sum(getattr(row[3], n) for row in rows) for n in ("refused", "unreachable_goals")
        ]
        yield f"| `{world}` | {scores} | {refused_of[0]} of {refused_of[1]} |"


def removals(bags: Path) -> Iterator[str]:
    """How long the box of `moving` outlives its being taken away, of all that is looked at."""
    yield "| `moving` | taken away at | first beam through its place | phantom cells then | "\
        "gone after | longest of one cell | scans through it | left at the end |"  # fmt: skip
    yield "|---" * 8 + "|"
    for seed in SEEDS:
        for rule in RULES:
            name = {"paper": "literal", "candidate": "default"}[rule]
            yield f"| seed {seed}, {name} | " + removal(bags / f"moving_{seed}", rule) + " |"


def removal(path: Path, rule: str) -> str:
    """One drive's row of `removals`; every phantom cell is watched after every scan."""
    geometry, ground, removed_at = box_of(path)
    place = np.isfinite(removed_at)
    first = np.full(place.shape, np.nan)  # [s] when a cell was first looked through
    last_phantom = np.full(place.shape, np.nan)  # [s] when it was last seen to be one
    looks = np.zeros(place.shape, int)
    before: NDArray | None = None  # phantoms at the first look
    for seconds, reading, phantom in watched(path, rule, geometry, ground):
        through = looked_through(reading, geometry, ground, place & (removed_at <= seconds))
        if before is None and through.any():
            before = phantom & place
        looks += through & phantom
        first[through & np.isnan(first)] = seconds
        last_phantom[phantom & np.isfinite(first)] = seconds
        remaining = phantom & place
    if before is None:
        return "not looked at |" + " |" * 5
    watched_cells = before & np.isfinite(first)
    start = np.nanmin(first)
    gone = np.nanmax(last_phantom[watched_cells], initial=start) - start
    each = np.nanmax((last_phantom - first)[watched_cells], initial=0.0)
    left = remaining & np.isfinite(first)
    return (
        f"{np.nanmin(removed_at):.2f} s | {start:.2f} s | {before.sum()} | {gone:.2f} s | "
        f"{each:.2f} s | {looks[watched_cells].max(initial=0)} | {left.sum()} of {remaining.sum()}"
    )


def box_of(path: Path) -> tuple[Geometry, NDArray, NDArray]:
    """Cells of the truth, height of the ground below them, when the box in them went [s]."""
    file = path / "truth" / "surface.npz"
    with np.load(file) as archive:
        return read_truth(file).geometry, archive["ground"], archive["removed_at"]


def watched(
    path: Path, rule: str, geometry: Geometry, ground: NDArray
) -> Iterator[tuple[float, Reading, NDArray]]:
    """After every scan: its time [s], the scan, and the phantoms, on the cells of the truth."""
    with Bag(path) as bag:
        topics = bag.scan_topics()
        settings = with_values(Params(), {"intake.scan_topics": topics, "mapper.update_rule": rule})
        mapping = Mapping(settings)
        for event in bag.events([*topics, "/odom", "/tf_static"]):
            for reading in feed(mapping, event.topic, event.message):
                iy, ix = mapping.grid.geometry.cell_at(geometry.cell_center((0, 0)))
                area = Area(int(iy), int(ix), *geometry.shape)
                heights = mapping.grid.read(settings.mapper.probability_threshold, area)
                above = heights.metres - ground
                seconds = (reading.scan.stamp_ns - EPOCH_NS) / 1e9
                yield seconds, reading, (above > PHANTOM) & heights.known


def looked_through(
    reading: Reading, geometry: Geometry, ground: NDArray, place: NDArray
) -> NDArray[np.bool_]:
    """Which cells of a place a scan's beams pass lower than the box was high."""
    through = np.zeros(place.shape, bool)
    if not place.any():
        return through
    beams = reading.beams(Params())
    rows, columns = np.nonzero(place)
    low = geometry.cell_corner((rows.min(), columns.min()))
    high = geometry.cell_corner((rows.max() + 1, columns.max() + 1))
    way = beams.ends - beams.origins
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([low - beams.origins[:, :2], high - beams.origins[:, :2]]) / way[:, :2]
    entered = np.clip(sides.min(axis=0).max(axis=1), 0.0, 1.0)
    left = np.clip(sides.max(axis=0).min(axis=1), 0.0, 1.0)
    meets = left > entered
    fractions = np.linspace(0.0, 1.0, SAMPLES)
    t = entered[meets, None] + fractions * (left - entered)[meets, None]
    points = beams.origins[meets, None] + t[..., None] * way[meets, None]
    cells = geometry.cell_at(points[..., :2].reshape(-1, 2))
    inside = geometry.contains(cells)
    cells, z = cells[inside], points[..., 2].reshape(-1)[inside]
    is_low = z < ground[cells[:, 0], cells[:, 1]] + BOX_HEIGHT
    through[cells[is_low, 0], cells[is_low, 1]] = True
    return through & place


if __name__ == "__main__":
    sys.exit(main())
