"""The command line of scripts that render shots by their names, or pictures of some frames. Needs no Blender."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Sequence
from pathlib import Path


def render_chosen(
    description: str | None,
    known: Collection[str],
    render: Callable[[str, Path], None],
    preview: Callable[[str, Sequence[int], Path], None],
) -> None:
    """Render the shots that the command line names, or all, or previews of some of their frames.

    Parameters
    ----------
    description : str
        Of the script, for its help.
    known : collection of str
        Names of all shots.
    render : callable
        Renders the shot of a name into a folder of that name.
    preview : callable
        Writes pictures of some frames of the shot of a name into a folder.
    """
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=description, formatter_class=form)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"by default all: {', '.join(known)}")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--preview", type=int, nargs="+", metavar="FRAME", help="these frames only")
    args = parser.parse_args()
    if unknown := sorted(set(args.names) - set(known)):
        parser.error(f"there is no {', '.join(unknown)}; there are {', '.join(known)}")
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.names or known:
        if args.preview:
            preview(name, args.preview, args.out)
        else:
            render(name, args.out)
