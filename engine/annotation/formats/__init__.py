"""Formats of label maps, in and out. Each file has `write(maps, out)`, which yields the frames that are done, and `read`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from degense.engine.annotation.formats import coco, cvat, cvat_video, dicom_seg, label_studio, nifti, pictures, seg_nrrd, yolo
from degense.engine.annotation.formats.map_set import MapSet
from degense.engine.annotation.formats.pictures import CHOLECSEG8K, ENDOVIS18

__all__ = ["LABEL_FORMATS", "LabelFormat", "MapSet"]


@dataclass(frozen=True)
class LabelFormat:
    """One way in and out; the suffix is that of a file, empty for a folder.

    `write` yields the frames done, DegenseError when it cannot be written. `read` takes a path, the shape and the names of the clip's
    frames, ClipError when the file is damaged or does not fit the clip.
    """

    title: str
    suffix: str
    write: Callable[[MapSet, Path], Iterator[int]]
    read: Callable[[Path, tuple[int, int], Sequence[str]], MapSet]


LABEL_FORMATS = {
    "masks-png": LabelFormat("label maps (indexed PNG)", "", pictures.write, pictures.read),
    "coco": LabelFormat("COCO (JSON, run lengths)", ".json", coco.write, coco.read),
    "cvat": LabelFormat("CVAT for images 1.1 (XML)", ".xml", cvat.write, cvat.read),
    "cvat-video": LabelFormat("CVAT for video 1.1 (XML, tracks)", ".xml", cvat_video.write, cvat_video.read),
    "label-studio": LabelFormat("Label Studio (JSON, brush masks)", ".json", label_studio.write, label_studio.read),
    "yolo": LabelFormat("YOLO segments", "", yolo.write, yolo.read),
    "nifti": LabelFormat("NIfTI label volume", ".nii.gz", nifti.write, nifti.read),
    "seg-nrrd": LabelFormat("3D Slicer segmentation (NRRD)", ".seg.nrrd", seg_nrrd.write, seg_nrrd.read),
    "dicom-seg": LabelFormat("DICOM segmentation", ".dcm", dicom_seg.write, dicom_seg.read),
    "cholecseg8k": LabelFormat("CholecSeg8k colour masks", "", CHOLECSEG8K.write, CHOLECSEG8K.read),
    "endovis18": LabelFormat("EndoVis 2018 colour masks", "", ENDOVIS18.write, ENDOVIS18.read),
}
