"""Reproducing the papers' experiments: `python -m kfmocap.benchmarks.experiments walk --out results`.

Y. Ohta, T. Yamagiwa, M. Yamamoto, Keyframe Tracking of Human Body in 3D Motion from a Monocular Image Sequence (1998),
sections 5.5 and 6.1, and S. Shishido, M. Saito, T. Ando, 3D Motion Capturing Using Body Model, section 4; on footage
rendered by this repository, whose truth is known.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import KFMocapError
from ..core.runtime.output_files.files import check_writable, replacing, staged
from .experiments_pictures import write_jpeg
from .experiments_runs import ExperimentResult, RenderedShot, say, throw, walk, whirl
from .footage_renderer import ROOT, render

CACHE = ROOT / "build" / "experiments"
PAGE = ROOT / "docs" / "experiments.md"
"""The page with the tables, between `<!-- NAME -->` and `<!-- end -->`; pictures are in the same folder."""


@dataclass(frozen=True)
class Experiment:
    """An experiment, and the take of `tools/render_footage.py` that it uses."""

    take: str
    run: Callable[[RenderedShot], ExperimentResult]


EXPERIMENTS = {
    "walk": Experiment("crossing", walk),
    "throw": Experiment("throw", throw),
    "whirl": Experiment("whirl", whirl),
}


def rendered(take: str) -> Path:
    """Return the folder of a take's footage, which is rendered the first time.

    Raises
    ------
    FootageError
        It cannot be rendered.
    """
    say(f"the footage of '{take}' is rendered, unless it is in {CACHE / take} ...")
    render("render_footage.py", [take, "--out", str(CACHE / take)], what=take)
    return CACHE / take


def write(out_dir: Path, name: str, outcome: ExperimentResult) -> None:
    """Write NAME.md, NAME.json and the pictures."""
    with staged(out_dir) as stage:
        (stage / f"{name}.md").write_text(outcome.text + "\n", encoding="utf-8")
        (stage / f"{name}.json").write_text(json.dumps(outcome.scores, indent=1) + "\n", encoding="utf-8")
        for picture, image in outcome.pictures.items():
            write_jpeg(stage / f"{picture}.jpg", image)


def publish(page: Path, name: str, outcome: ExperimentResult) -> None:
    """Replace an experiment's table and pictures in a page of the documentation."""
    text = page.read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->\n", "\n<!-- end -->"
    before, after = text.split(begin)
    with replacing(page) as temporary:
        table = f"{begin}\n{outcome.text}\n{end}"
        temporary.write_text(before + table + after.split(end, 1)[1], encoding="utf-8")
    for picture, image in outcome.pictures.items():
        write_jpeg(page.with_name(f"{page.stem}_{picture}.jpg"), image)


def parser() -> argparse.ArgumentParser:
    """Build the parser of the command line."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.experiments", description=__doc__)
    parser.add_argument("name", choices=[*EXPERIMENTS, "all"])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for tables and pictures")
    parser.add_argument("--docs", action="store_true", help="also put them into docs/experiments.md")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run experiments, print their tables and write the results; returns the exit code."""
    args = parser().parse_args(argv)
    try:
        check_writable(args.out)
        for name in EXPERIMENTS if args.name == "all" else [args.name]:
            experiment = EXPERIMENTS[name]
            outcome = experiment.run(RenderedShot.load(rendered(experiment.take)))
            write(args.out, name, outcome)
            if args.docs:
                publish(PAGE, name, outcome)
            print(f"{name}\n\n{outcome.text}\n")
    except KFMocapError as error:
        print(f"experiments: error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
