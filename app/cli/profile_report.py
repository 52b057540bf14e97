"""What `degense train --profile` leaves: a table in words, profile.json and profile.svg."""

from __future__ import annotations

import json
from pathlib import Path

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from degense.engine.files import replacing, write_text
from degense.engine.profile import Path as PartPath
from degense.engine.profile import Profile

LEAST = 0.005  # of the whole: what took less is not shown, but is in profile.json
BAR = 24  # characters of the longest bar
OWN, WITHIN = "#0072B2", "#9ecae1"


def write_profile(profile: Profile, folder: Path) -> str:
    """Write profile.json and profile.svg into `folder`; the table to print."""
    parts = [
        {"part": list(path), "seconds": round(profile.within(path), 6), "own": round(spent.own, 6), "calls": spent.calls}
        for path, spent in profile.spent.items()
    ]
    whole = {"seconds": round(profile.seconds, 6), "device": profile.device, "parts": parts}
    write_text(folder / "profile.json", json.dumps(whole, indent=1))
    shown = [path for path in in_order(profile) if path and profile.within(path) >= LEAST * profile.seconds]
    _draw(profile, shown, folder / "profile.svg")
    lines = [f"{'part':<34} {'s':>8} {'%':>6} {'calls':>7}"]
    for path in shown:
        share = profile.within(path) / profile.seconds
        name = "  " * (len(path) - 1) + path[-1]
        lines.append(f"{name:<34} {profile.within(path):8.2f} {share:6.1%} {profile.spent[path].calls:7,}  {'█' * round(BAR * share)}")
    lines.append(f"{'all':<34} {profile.seconds:8.2f}   {folder / 'profile.svg'}")
    return "\n".join(lines)


def in_order(profile: Profile) -> list[PartPath]:
    """The parts, each followed by those within it: stages as they began, parts of a stage by their time."""

    def below(path: PartPath) -> list[PartPath]:
        children = [other for other in profile.spent if len(other) == len(path) + 1 and other[: len(path)] == path]
        if path:
            children.sort(key=profile.within, reverse=True)
        return [path, *(found for child in children for found in below(child))]

    return below(())


def _draw(profile: Profile, shown: list[PartPath], path: Path) -> None:
    """Bars: a part's time, and in it, dark, what is of none of the parts within it."""
    figure = Figure(figsize=(8.0, 1.0 + 0.22 * len(shown)), facecolor="white", layout="constrained")
    axes = figure.add_subplot()
    rows = range(len(shown))
    axes.barh(rows, [profile.within(part) for part in shown], color=WITHIN, label="with the parts within it")
    axes.barh(rows, [profile.spent[part].own for part in shown], color=OWN, label="its own")
    axes.set_yticks(rows, ["    " * (len(part) - 1) + part[-1] for part in shown], fontsize=8, ha="left")
    axes.tick_params("y", pad=150, length=0)
    axes.invert_yaxis()
    axes.set_xlabel(f"seconds, of {profile.seconds:.1f} on {profile.device}")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, axis="x", color="#e4e4e4")
    axes.set_axisbelow(True)
    axes.legend(frameon=False, fontsize=8)
    with replacing(path) as temporary:
        FigureCanvasSVG(figure).print_svg(str(temporary), metadata={"Date": None})
