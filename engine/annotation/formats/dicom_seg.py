"""DICOM segmentations: one binary frame for each class in each labelled frame.

The clip is no DICOM series, so the images that the standard wants referenced are named by identifiers made from the names of the frames,
and lie in a stack: pixels are 1 mm wide, frame k lies at z = k mm. Objects of one class have one property type.
"""

from __future__ import annotations

import io
import struct
import uuid
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.engine.annotation.edits import LabelClass, default_colour
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size, checked_classes
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError, DegenseError, what_is_wrong
from degense.engine.files import replacing
from degense.engine.untrusted import read_bytes

if TYPE_CHECKING:  # an extra
    from pydicom import Dataset

LARGEST = 1 << 30
SECONDARY_CAPTURE, SEGMENTATION = "1.2.840.10008.5.1.4.1.1.7", "1.2.840.10008.5.1.4.1.1.66.4"
#: Uncompressed pixels; compressed ones could unpack to anything.
PLAIN = ("1.2.840.10008.1.2", "1.2.840.10008.1.2.1")
#: What pydicom raises at values that are none, most of them when they are asked for.
BROKEN = (OSError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError, EOFError, RuntimeError, struct.error)
#: What an image of no patient leaves empty.
UNKNOWN = (
    *("PatientID", "PatientName", "PatientBirthDate", "PatientSex", "AccessionNumber", "StudyID", "StudyDate", "StudyTime"),
    *("ReferringPhysicianName", "PositionReferenceIndicator"),
)
LONGEST_LABEL, LONGEST_DESCRIPTION = 64, 1024


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`; yields the frames done. DegenseError where nothing is labelled, or highdicom is not installed."""
    try:
        import highdicom
    except ImportError as error:
        raise DegenseError("DICOM segmentations need highdicom; install it with: pip install 'degense[dicom]'.") from error
    frames = []
    for frame in maps.frames:
        frames.append(maps.read(frame) + np.uint8(1))
        yield frame
    if not any(labels.any() for labels in frames):
        raise DegenseError("No pixel is labelled, and a DICOM segmentation cannot be empty.")
    seg = highdicom.seg.Segmentation(
        [_source(maps, frame) for frame in maps.frames],
        np.stack(frames),
        highdicom.seg.SegmentationTypeValues.BINARY,
        [_described(kind, number, maps.classes) for number, kind in enumerate(maps.classes, 1)],
        series_instance_uid=_uid(maps, "segmentation"),
        series_number=2,
        sop_instance_uid=str(highdicom.UID()),
        instance_number=1,
        manufacturer="DeGense",
        manufacturer_model_name="DeGense",
        software_versions="1",
        device_serial_number="0",
    )
    with replacing(out) as temporary:
        seg.save_as(temporary)


def _uid(maps: MapSet, *words: str) -> str:
    """An identifier that the same clip always gets."""
    return f"2.25.{uuid.uuid5(uuid.NAMESPACE_URL, '/'.join(('degense', *maps.names[:1], str(len(maps.names)), *words))).int}"


def _source(maps: MapSet, frame: int) -> Dataset:
    """What the segmentation refers to as the image of a frame."""
    from pydicom import Dataset
    from pydicom.dataset import FileMetaDataset
    from pydicom.uid import UID

    image = Dataset()
    for name in UNKNOWN:
        setattr(image, name, "")
    image.SOPClassUID, image.SOPInstanceUID = SECONDARY_CAPTURE, _uid(maps, "frame", maps.names[frame])
    image.StudyInstanceUID, image.SeriesInstanceUID = _uid(maps, "study"), _uid(maps, "series")
    image.FrameOfReferenceUID = _uid(maps, "stack")
    image.Rows, image.Columns = maps.shape
    image.Modality, image.InstanceNumber = "ES", frame + 1
    image.ImagePositionPatient, image.ImageOrientationPatient = [0, 0, frame], [1, 0, 0, 0, 1, 0]
    image.PixelSpacing, image.SliceThickness = [1, 1], 1
    image.file_meta = FileMetaDataset()
    image.file_meta.TransferSyntaxUID = UID(PLAIN[1])
    return image


def _described(kind: LabelClass, number: int, classes: Sequence[LabelClass]) -> Any:
    from highdicom.color import CIELabColor
    from highdicom.seg import SegmentDescription
    from highdicom.sr.coding import CodedConcept

    first = next(index for index, other in enumerate(classes, 1) if other.name.casefold() == kind.name.casefold())
    described = SegmentDescription(
        segment_number=number,
        segment_label=kind.title[:LONGEST_LABEL],
        segmented_property_category=CodedConcept("123037004", "SCT", "Anatomical Structure"),
        segmented_property_type=CodedConcept(str(first), "99DEGENSE", kind.name[:LONGEST_LABEL]),
        algorithm_type="SEMIAUTOMATIC",
        algorithm_identification=_algorithm(),
        display_color=CIELabColor.from_rgb(*kind.colour),
    )
    described.SegmentDescription = kind.name
    return described


def _algorithm() -> Any:
    from highdicom import AlgorithmIdentificationSequence
    from highdicom.sr.coding import CodedConcept

    return AlgorithmIdentificationSequence("DeGense", CodedConcept("123109", "DCM", "Manual Processing"), "1")


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The segments of a file; higher numbers are on top. ClipError when it is damaged or does not fit the clip."""
    try:
        import pydicom
        from pydicom.errors import BytesLengthException, InvalidDicomError
    except ImportError as error:
        raise ClipError("DICOM segmentations need highdicom; install it with: pip install 'degense[dicom]'.") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is wrong but can be read
            content = read_bytes(path, LARGEST)  # from a file pydicom takes as much memory as a damaged length says
            if _syntax(content) not in PLAIN:
                raise ClipError(f"{shown(path)} is compressed, or no DICOM file; save it uncompressed (Explicit VR Little Endian).")
            data = pydicom.dcmread(io.BytesIO(content))
            planes = _planes(data, shape, len(names), path)
            pixels = bytes(data.PixelData)
            classes = _classes(data, path)
            index = {int(item.SegmentNumber): value for value, item in enumerate(data.SegmentSequence)}
            found: dict[int, list[tuple[int, int]]] = {}
            for place, (frame, segment) in enumerate(planes):
                found.setdefault(frame, []).append((index[segment], place))
    except (*BROKEN, InvalidDicomError, BytesLengthException) as error:
        raise ClipError(f"{shown(path)} is damaged or no binary DICOM segmentation ({what_is_wrong(error)}).") from error
    if (len(planes) * shape[0] * shape[1] + 7) // 8 > len(pixels):
        raise ClipError(f"{shown(path)} is cut short; copy it again.")

    def labels(frame: int) -> np.ndarray:
        size, labels = shape[0] * shape[1], np.full(shape, UNLABELLED, np.uint8)
        for value, place in sorted(found[frame]):
            first = place * size
            part = np.frombuffer(pixels, np.uint8)[first // 8 : (first + size + 7) // 8]
            mask = np.unpackbits(part, bitorder="little")[first % 8 :][:size]
            labels[mask.reshape(shape) > 0] = value
        return labels

    return MapSet(classes, shape, tuple(names), tuple(sorted(found)), labels)


def _syntax(content: bytes) -> Any:
    """How the rest is written, from the group of elements that stands before it. ValueError where there is none."""
    from pydicom.filereader import read_dataset

    if content[128:132] != b"DICM":
        raise ValueError("no DICOM file")
    about = io.BytesIO(content)
    about.seek(132)
    return read_dataset(about, False, True, stop_when=lambda tag, vr, length: tag.group != 2).get("TransferSyntaxUID")


def _planes(data: Dataset, shape: tuple[int, int], count: int, path: Path) -> list[tuple[int, int]]:
    """Frame of the clip and segment number of each plane of bits."""
    if data.SOPClassUID != SEGMENTATION or data.SegmentationType != "BINARY" or data.BitsAllocated != 1:
        raise ValueError("it is of another kind")
    check_picture_size((int(data.Columns), int(data.Rows)), shape, path)
    groups = data.PerFrameFunctionalGroupsSequence
    if int(data.NumberOfFrames) != len(groups):
        raise ValueError(f"{data.NumberOfFrames} frames, but {len(groups)} are described")
    found = []
    for group in groups:
        frame = _frame(group)
        if not 0 <= frame < count:
            raise ClipError(f"{shown(path)} has a mask of frame {frame}, but the clip has {count} frames.")
        segment = group if "SegmentIdentificationSequence" in group else data.SharedFunctionalGroupsSequence[0]  # where there is but one
        found.append((frame, int(segment.SegmentIdentificationSequence[0].ReferencedSegmentNumber)))
    return found


def _frame(group: Dataset) -> int:
    """The frame of the clip, from 0: as a frame of the referenced video, else as the height in the stack. ValueError for neither."""
    for derivation in group.get("DerivationImageSequence", []):
        for source in derivation.get("SourceImageSequence", []):
            if "ReferencedFrameNumber" in source:
                return int(source.ReferencedFrameNumber) - 1
    height = float(group.PlanePositionSequence[0].ImagePositionPatient[2])
    if height != round(height):
        raise ValueError(f"a mask at height {height:g}, which is no frame")
    return round(height)


def _classes(data: Dataset, path: Path) -> tuple[LabelClass, ...]:
    """Of our own segmentations with names in full and objects; those of other tools by the labels of their segments."""
    own = data.get("ManufacturerModelName") == "DeGense"
    counts: Counter[str] = Counter()
    classes = []
    for index, item in enumerate(data.SegmentSequence):
        name = str(item.SegmentDescription if own else item.SegmentLabel)
        counts[name.casefold()] += 1
        classes.append(LabelClass(name, _colour(item, index), counts[name.casefold()]))
    return checked_classes(classes, path)


def _colour(item: Dataset, index: int) -> tuple[int, int, int]:
    if "RecommendedDisplayCIELabValue" not in item:
        return default_colour(index)
    from highdicom.color import CIELabColor

    red, green, blue = CIELabColor.from_dicom_value(item.RecommendedDisplayCIELabValue).to_rgb()
    return red, green, blue
