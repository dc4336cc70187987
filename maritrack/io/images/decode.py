"""Octets of an image to its pixels, with bounded memory: the size is looked at before anything is unpacked."""

from __future__ import annotations

import io
import struct
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from maritrack.errors import MaritrackError

FORMATS = ("PNG", "JPEG", "TIFF")
BROKEN = (
    MaritrackError, ArithmeticError, LookupError, ValueError, TypeError, OSError, MemoryError, SyntaxError, EOFError,
    RuntimeError, struct.error,
)  # what Pillow has  # fmt: skip
DEEP = ("I;16", "I;16B", "I;16L", "I;16N", "I", "F")  # modes of more than 8 bit


class LeftOut(Exception):
    """An image that can't be used, and the code of the damage."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


def decode(data: bytes, *, max_pixels: int, size_px: tuple[int, ...] = ()) -> NDArray[np.uint8]:
    """Pixels (h, w) of a grey image, (h, w, 4) of a coloured one: red, green, blue and something.

    `size_px` is the width and height that it must have. Raises LeftOut.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow: about what is then refused or read all the same
            with Image.open(io.BytesIO(data), formats=FORMATS) as image:
                width, height = image.size
                if width * height > max_pixels:
                    raise LeftOut("image-too-large", f"{width} x {height} pixels, at most {max_pixels} are read")
                if size_px and (width, height) != tuple(size_px):
                    raise LeftOut("image-size", f"{width} x {height} pixels, not {size_px[0]} x {size_px[1]}")
                return _pixels(image)
    except Image.DecompressionBombError:  # Pillow's own limit, before one can look
        raise LeftOut("image-too-large", f"far more than {max_pixels} pixels") from None
    except BROKEN as error:
        said = " ".join(str(error).split())[:120] or type(error).__name__
        raise LeftOut("image-unreadable", said) from None


def _pixels(image: Any) -> NDArray[np.uint8]:
    if image.mode in DEEP:
        deep = np.asarray(image, np.float64)
        scale = 255.0 / 65535.0 if image.mode != "F" or deep.max(initial=0.0) > 1.0 else 255.0
        return np.clip(np.nan_to_num(deep) * scale, 0, 255).astype(np.uint8)
    if image.mode in ("L", "1", "LA", "La"):
        return np.asarray(image.convert("L"))
    return np.asarray(image.convert("RGBX"))  # four octets a pixel: one number of 32 bit each
