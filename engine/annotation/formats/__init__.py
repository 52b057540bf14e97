"""Formats of label maps, in and out. Each file has `write(maps, out)`, which yields the frames that are done, and `read`.

A file is imported when its format is first used: a window lists the formats long before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from degense.engine.annotation.formats.map_set import MapSet

__all__ = ["LABEL_FORMATS", "LabelFormat", "MapSet"]


@dataclass(frozen=True)
class LabelFormat:
    """One way in and out; the suffix is that of a file, empty for a folder."""

    title: str
    suffix: str
    place: str  # the file of this folder, or a table in it ("file:table"), that has `write` and `read`

    def write(self, maps: MapSet, out: Path) -> Iterator[int]:
        """Yields the frames done. DegenseError when it cannot be written."""
        written: Iterator[int] = self._found().write(maps, out)
        return written

    def read(self, path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
        """From a path, the shape and the names of the clip's frames. ClipError when the file is damaged or does not fit the clip."""
        maps: MapSet = self._found().read(path, shape, names)
        return maps

    def _found(self) -> Any:
        module, _, table = self.place.partition(":")
        loaded = import_module(f"{__name__}.{module}")
        return getattr(loaded, table) if table else loaded


LABEL_FORMATS = {
    "masks-png": LabelFormat("label maps (indexed PNG)", "", "pictures"),
    "coco": LabelFormat("COCO (JSON, run lengths)", ".json", "coco"),
    "cvat": LabelFormat("CVAT for images 1.1 (XML)", ".xml", "cvat"),
    "cvat-video": LabelFormat("CVAT for video 1.1 (XML, tracks)", ".xml", "cvat_video"),
    "label-studio": LabelFormat("Label Studio (JSON, brush masks)", ".json", "label_studio"),
    "yolo": LabelFormat("YOLO segments", "", "yolo"),
    "nifti": LabelFormat("NIfTI label volume", ".nii.gz", "nifti"),
    "seg-nrrd": LabelFormat("3D Slicer segmentation (NRRD)", ".seg.nrrd", "seg_nrrd"),
    "dicom-seg": LabelFormat("DICOM segmentation", ".dcm", "dicom_seg"),
    "cholecseg8k": LabelFormat("CholecSeg8k colour masks", "", "pictures:CHOLECSEG8K"),
    "endovis18": LabelFormat("EndoVis 2018 colour masks", "", "pictures:ENDOVIS18"),
}
