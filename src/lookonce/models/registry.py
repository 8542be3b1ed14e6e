"""The detectors that lookonce knows how to get: where their files are, how large, with which digest and licence.

A digest is what somebody else published, and ``source`` says who: a file that is swapped at its address is refused.
Where nobody did, it is ours, taken from the copy that the tests of this project run on, and ``source`` says so.
Sizes in bytes agree with the networks: a weights file is its header and 4 bytes for each parameter of its cfg.
"""

from __future__ import annotations

import string
from dataclasses import dataclass

from lookonce.errors import DownloadError

__all__ = ["DIGEST_LENGTHS", "Digest", "KnownFile", "KnownModel", "find_known", "known_models"]

DIGEST_LENGTHS = {"sha256": 64, "sha1": 40}  # in hex digits; SHA-1 finds damage, but does not stop a forger


@dataclass(frozen=True, slots=True)
class Digest:
    """What a file's bytes must add up to.

    Attributes:
        algorithm: ``sha256``, or ``sha1`` where nobody published better.
        value: lower-case hex digits.
        source: who published it: an address, or a sentence.
    """

    algorithm: str
    value: str
    source: str

    def __post_init__(self) -> None:
        length = DIGEST_LENGTHS.get(self.algorithm)
        if length is None:
            raise ValueError(f"algorithm: expected one of {', '.join(DIGEST_LENGTHS)}, got {self.algorithm}")
        if len(self.value) != length or not set(self.value) <= set(string.hexdigits.lower()):
            raise ValueError(f"value: expected {length} lower-case hex digits, got {self.value!r}")


@dataclass(frozen=True, slots=True)
class KnownFile:
    """One file of a known model.

    Attributes:
        name: its name in the cache, without a folder.
        size_bytes: its exact length.
        digest: of its content.
        urls: where it can be had, in the order to try; all hold the same bytes.
    """

    name: str
    size_bytes: int
    digest: Digest
    urls: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.name or set(self.name) & set("/\\:") or self.name.startswith("."):
            raise ValueError(f"name: expected a plain file name, got {self.name!r}")
        if self.size_bytes <= 0 or not self.urls:
            raise ValueError(f"{self.name}: expected a size above 0 and at least one address")


@dataclass(frozen=True, slots=True)
class KnownModel:
    """A published detector.

    Attributes:
        name: what ``lookonce models get`` calls it.
        cfg: its network description.
        weights: its parameters.
        names: its class names, one a line.
        classes: the names in a few words.
        sizes_px: the usual input sizes, the cfg's own first.
        license: terms of the weights, kept in the model file.
        license_url: where they are stated.
    """

    name: str
    cfg: KnownFile
    weights: KnownFile
    names: KnownFile
    classes: str
    sizes_px: tuple[int, ...]
    license: str
    license_url: str

    @property
    def files(self) -> tuple[KnownFile, ...]:
        """All that an import needs, small files first."""
        return self.cfg, self.names, self.weights

    @property
    def size_bytes(self) -> int:
        """All files together."""
        return sum(file.size_bytes for file in self.files)


_RAW = "https://raw.githubusercontent.com"
_PJREDDIE = f"{_RAW}/pjreddie/darknet/f6afaabcdf85f77e7aff2ec55c020c0e297c77f9"
_ALEXEYAB = f"{_RAW}/AlexeyAB/darknet/59596d7880f6504768df41d6daa586f5cb2b932f"
_FASTEST = f"{_RAW}/dog-qiuqiu/Yolo-Fastest"
_PJREDDIE_FILES = "https://data.pjreddie.com/files"  # linked from the author's page; pjreddie.com/media is gone
_ALEXEYAB_RELEASES = "https://github.com/AlexeyAB/darknet/releases/download"
_HANK_AI = "https://github.com/hank-ai/darknet/releases/download/v2.0"

# who published the digests
_PURDUE = (
    "https://github.com/PurdueDualityLab/TensorFlowModels/blob/279b49894f17e64feb6e6a8f9c3d00a1b035105d"
    "/yolo/utils/downloads/file_manager.py"
)
_EMGU = "https://github.com/emgucv/emgucv/blob/840955d88053165c8c7c7f9565ea895ed0969786/Emgu.CV.Models/Dnn/Yolo.cs"
_ZOO = "https://github.com/openvinotoolkit/open_model_zoo/blob"
_ZOO_V4 = f"{_ZOO}/1181ca55e1f2eef5f5f9991a0dc918aebe0eaa11/models/public/yolo-v4-tf/model.yml"
_ZOO_V4_TINY = f"{_ZOO}/00a4830eb152f9791749f282e7b076040e962ab0/models/public/yolo-v4-tiny-tf/model.yml"
_AUR = "https://aur.archlinux.org/cgit/aur.git/tree/PKGBUILD?h=zmeventnotification (6.1.23)"
_OURS = "lookonce, from the copy that its tests run on; none found elsewhere"

_YOLO_LICENSE = "YOLO LICENSE v2 (public domain)"
_PJREDDIE_LICENSE = "https://github.com/pjreddie/darknet/blob/f6afaabcdf85f77e7aff2ec55c020c0e297c77f9/LICENSE"
_ALEXEYAB_LICENSE = "https://github.com/AlexeyAB/darknet/blob/59596d7880f6504768df41d6daa586f5cb2b932f/LICENSE"
_FASTEST_LICENSE = "https://github.com/dog-qiuqiu/Yolo-Fastest/blob/master/LICENSE"


def _file(name: str, size_bytes: int, sha256: str, source: str, *urls: str) -> KnownFile:
    return KnownFile(name, size_bytes, Digest("sha256", sha256, source), urls)


_COCO_NAMES = _file(
    "coco.names",
    625,
    "634a1132eb33f8091d60f2c346ababe8b905ae08387037aed883953b7329af84",
    _EMGU,
    f"{_PJREDDIE}/data/coco.names",
)


def _coco(license_url: str, cfg: KnownFile, weights: KnownFile, *sizes_px: int) -> KnownModel:
    """A model trained on COCO under Darknet's licence, as all of them are."""
    name = weights.name.removesuffix(".weights")
    return KnownModel(name, cfg, weights, _COCO_NAMES, "80 of COCO", sizes_px, _YOLO_LICENSE, license_url)


_KNOWN = (
    _coco(
        _FASTEST_LICENSE,
        _file(
            "yolo-fastest-1.1.cfg",
            9_685,
            "f6df5775c1e862998cf69046eba9265be3ae84dfe8b2caab7529823f0795bf70",
            _OURS,
            f"{_FASTEST}/99d03d0f26e2555275bdb30f43479d47cc19311f/ModelZoo/yolo-fastest-1.1_coco/yolo-fastest-1.1.cfg",
        ),
        _file(
            "yolo-fastest-1.1.weights",
            1_384_268,
            "1c445c42bbd6df63edea2cc69f99667b5650d663ca11e34b116240740cd42890",
            _OURS,
            f"{_FASTEST}/99d03d0f26e2555275bdb30f43479d47cc19311f/ModelZoo/yolo-fastest-1.1_coco"
            "/yolo-fastest-1.1.weights",
        ),
        320,
        512,
    ),
    _coco(
        _FASTEST_LICENSE,
        _file(
            "yolo-fastest-1.1-xl.cfg",
            9_696,
            "c458427acc4fbeabceff4528ef7b65b066c0308ce599460f8ba299eba63abad3",
            _OURS,
            f"{_FASTEST}/9c62b1c50e024fb73d29a651133b1d63548e63a1/ModelZoo/yolo-fastest-1.1_coco"
            "/yolo-fastest-1.1-xl.cfg",
        ),
        _file(
            "yolo-fastest-1.1-xl.weights",
            3_693_964,
            "fac5fb41786c1f38f04972a658443b189f48720d7d117f9a044100e98a35b0c5",
            _OURS,
            f"{_FASTEST}/9c62b1c50e024fb73d29a651133b1d63548e63a1/ModelZoo/yolo-fastest-1.1_coco"
            "/yolo-fastest-1.1-xl.weights",
        ),
        320,
        512,
    ),
    _coco(
        _PJREDDIE_LICENSE,
        _file(
            "yolov2.cfg",
            2_726,
            "57d85d77262c840b56ad5418faae4950d9c7727e0192fb70618eeaac26a19817",
            _PURDUE,
            f"{_ALEXEYAB}/cfg/yolov2.cfg",
        ),
        _file(
            "yolov2.weights",
            203_934_260,
            "d9945162ed6f54ce1a901e3ec537bdba4d572ecae7873087bd730e5a7942df3f",
            _PURDUE,
            f"{_PJREDDIE_FILES}/yolov2.weights",
            f"{_HANK_AI}/yolov2.weights",
        ),
        416,
        608,
    ),
    _coco(
        _PJREDDIE_LICENSE,
        _file(
            "yolov3.cfg",
            8_342,
            "22489ea38575dfa36c67a90048e8759576416a79d32dc11e15d2217777b9a953",
            _EMGU,
            f"{_PJREDDIE}/cfg/yolov3.cfg",
        ),
        _file(
            "yolov3.weights",
            248_007_048,
            "523e4e69e1d015393a1b0a441cef1d9c7659e3eb2d7e15f793f060a21b32f297",
            _EMGU,
            f"{_PJREDDIE_FILES}/yolov3.weights",
            f"{_HANK_AI}/yolov3.weights",
        ),
        608,
        416,
        320,
    ),
    _coco(
        _PJREDDIE_LICENSE,
        _file(
            "yolov3-spp.cfg",
            8_606,
            "7a4ec2d7427340fb12059f2b0ef76d6fcfcac132cc287cbbf0be5e3abaa856fd",
            _EMGU,
            f"{_PJREDDIE}/cfg/yolov3-spp.cfg",
        ),
        _file(
            "yolov3-spp.weights",
            252_209_544,
            "87a1e8c85c763316f34e428f2295e1db9ed4abcec59dd9544f8052f50de327b4",
            _EMGU,
            f"{_PJREDDIE_FILES}/yolov3-spp.weights",
        ),
        608,
    ),
    _coco(
        _PJREDDIE_LICENSE,
        _file(
            "yolov3-tiny.cfg",
            1_915,
            "84eb7a675ef87c906019ff5a6e0effe275d175adb75100dcb47f0727917dc2c7",
            _EMGU,
            f"{_PJREDDIE}/cfg/yolov3-tiny.cfg",
        ),
        _file(
            "yolov3-tiny.weights",
            35_434_956,
            "dccea06f59b781ec1234ddf8d1e94b9519a97f4245748a7d4db75d5b7080a42c",
            _EMGU,
            f"{_PJREDDIE_FILES}/yolov3-tiny.weights",
            f"{_HANK_AI}/yolov3-tiny.weights",
        ),
        416,
    ),
    _coco(
        _ALEXEYAB_LICENSE,
        _file(
            "yolov4.cfg",
            12_231,
            "a6d0f8e5c62cc8378384f75a8159b95fa2964d4162e33351b00ac82e0fc46a34",
            _PURDUE,
            f"{_ALEXEYAB}/cfg/yolov4.cfg",
        ),
        _file(
            "yolov4.weights",
            257_717_640,
            "e8a4f6c62188738d86dc6898d82724ec0964d0eb9d2ae0f0a9d53d65d108d562",
            _ZOO_V4,
            f"{_ALEXEYAB_RELEASES}/darknet_yolo_v3_optimal/yolov4.weights",
            f"{_HANK_AI}/yolov4.weights",
        ),
        608,
        512,
        416,
    ),
    _coco(
        _ALEXEYAB_LICENSE,
        _file(
            "yolov4-tiny.cfg",
            3_231,
            "f858e3724962eedf3ac44e3b6cb3f0c3d9ed067c306bb831f539c578b924c90e",
            _AUR,
            f"{_ALEXEYAB}/cfg/yolov4-tiny.cfg",
        ),
        _file(
            "yolov4-tiny.weights",
            24_251_276,
            "cf9fbfd0f6d4869b35762f56100f50ed05268084078805f0e7989efe5bb8ca87",
            _ZOO_V4_TINY,
            f"{_ALEXEYAB_RELEASES}/darknet_yolo_v4_pre/yolov4-tiny.weights",
            f"{_HANK_AI}/yolov4-tiny.weights",
        ),
        416,
    ),
)


def known_models() -> dict[str, KnownModel]:
    """What can be had, by name."""
    return {model.name: model for model in _KNOWN}


def find_known(name: str) -> KnownModel:
    """The known model of that name.

    Raises:
        DownloadError: there is none.
    """
    known = known_models()
    if name not in known:
        raise DownloadError(f"{name}: not a model that can be had; known are {', '.join(known)}")
    return known[name]
