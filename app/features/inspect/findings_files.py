"""A ranking saved: as a table, or as a sheet of images of the worst places."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from degense.app.features.inspect.curves import table_of
from degense.app.features.viewer.layer_images import BACKGROUND, FONT, INK, get_layer, layer_rgb, write_png
from degense.engine.errors import DegenseError
from degense.engine.layer_titles import with_unit
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.layers import LayerRequest
    from degense.engine.layers.ranking import Finding, Ranking
    from degense.engine.scene import Scene

#: Pictures on a sheet, beside each other and in all, and the width of one.
ACROSS, PICTURES, WIDTH = 4, 12, 320
LINE = 26


def findings_table(findings: tuple[Finding, ...], statistic: str, unit: str, fps: float) -> str:
    """Comma-separated values, the worst first; `statistic` names what the values are."""
    columns = {
        "rank": np.arange(1, len(findings) + 1),
        "frame": np.array([finding.frame for finding in findings]),
        "time [s]": np.array([finding.frame / fps for finding in findings], float),
        "x [px]": np.array([finding.x for finding in findings], float),
        "y [px]": np.array([finding.y for finding in findings], float),
        with_unit(statistic.lower(), unit): np.array([finding.value for finding in findings], float),
    }
    return table_of(columns)


def findings_sheet(
    scene: Scene,
    ranking: Ranking,
    findings: tuple[Finding, ...],
    statistic: str,
    request: LayerRequest,
    span: tuple[float, float],
    out: Path,
) -> Steps[str]:
    """A PNG with the layer at each of the worst findings, circled, the worst first, under a line that names layer, statistic and unit.

    Yields (fraction, words).
    """
    from dataclasses import replace

    from skimage.util import montage

    if not findings:
        raise DegenseError("Nothing has been found yet, so there is nothing to draw.")
    layer, shown = get_layer(ranking.layer), findings[:PICTURES]
    tiles = []
    for done, finding in enumerate(shown):
        yield done / len(shown), f"frame {finding.frame}"
        image = layer_rgb(scene, layer, replace(request, frame=finding.frame), span)
        scale = WIDTH / image.shape[1]
        tile = cv2.resize(image, (WIDTH, round(image.shape[0] * scale)), interpolation=cv2.INTER_AREA)
        at = (round(finding.x * scale), round(finding.y * scale))
        for colour, width in ((0, 4), (255, 2)):
            cv2.circle(tile, at, WIDTH // 16, (colour,) * 3, width, cv2.LINE_AA)
        words = f"{done + 1}  frame {finding.frame}  {finding.value:.3g} {ascii_unit(ranking.unit)}"
        tiles.append(np.vstack([tile, caption(words, WIDTH)]))
    across = min(ACROSS, len(tiles))
    shape = (-(-len(tiles) // across), across)
    pictures = montage(tiles, fill=[BACKGROUND] * 3, grid_shape=shape, channel_axis=-1)
    heading = caption(f"{layer.title}: {with_unit(statistic, ascii_unit(ranking.unit))}", pictures.shape[1])
    write_png(out, np.vstack([heading, pictures]))
    return f"{out}: {len(shown)} frames"


def caption(words: str, width: int) -> np.ndarray:
    """A line of text, uint8 [LINE, width, 3]."""
    line = np.full((LINE, width, 3), BACKGROUND, np.uint8)
    cv2.putText(line, words, (6, LINE - 8), FONT, 0.5, (INK,) * 3, 1, cv2.LINE_AA)
    return line


def ascii_unit(unit: str) -> str:
    """A unit in the letters that OpenCV can write."""
    return unit.replace("°", "deg").replace("log₂", "log2")
