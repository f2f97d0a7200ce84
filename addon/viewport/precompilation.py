"""Precompilation of all shaders before the first picture: drivers compile a shader when it is first drawn with.

Each piece draws something invisible, one piece at a redraw, so that no redraw takes long.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import bpy
import numpy as np

from ..export.camera import film_size
from . import light_marks, overlay, shader, strokes, texture
from .camera_frame import Rectangle
from .view_table import View
from .views import redraw

PicturePiece = Callable[[tuple[int, int], tuple[int, int], View], object]
"""Draws one piece; called with the width and height of pictures, those of the region, and the view."""
PAUSE_SECONDS = 0.02
"""Pause between redraws, in which the artist's input is handled."""
NOTHING, POWER_OF_TWO = 3, 4
"""Edges of an invisible picture, in pixels. Drivers compile anew for edges that are powers of two."""

_is_requested = False
_picture_pieces: list[PicturePiece] = []
_word_pieces: list[Callable[[], object]] = []
"""Pieces that are not compiled yet: `_picture_pieces` draw pictures, `_word_pieces` draw over them."""


def request() -> None:
    """Requests that all remaining pieces are compiled in the next redraws."""
    global _is_requested
    _is_requested = bool(_picture_pieces or _word_pieces)
    if _is_requested and not bpy.app.timers.is_registered(redraw):
        bpy.app.timers.register(redraw, first_interval=PAUSE_SECONDS)


def is_pending() -> bool:
    """True if pieces are left to compile."""
    return _is_requested or bool(_picture_pieces)


def is_ready() -> bool:
    """True if drawing a picture compiles nothing."""
    return len(_picture_pieces) <= len(COMPARE_PIECES)


def are_words_ready() -> bool:
    """True if drawing over pictures compiles nothing."""
    return not (_picture_pieces or _word_pieces)


def draw_picture_piece(region: tuple[int, int], view: View) -> None:
    """Compiles the next piece that draws pictures, if one is requested; called while a region of that size is drawn."""
    if _is_requested and _picture_pieces:
        _picture_pieces.pop(0)(film_size(bpy.context.scene.render), region, view)
        request()


def draw_words_piece() -> None:
    """Compiles the next piece that draws over pictures, once all that draw pictures are compiled."""
    if _is_requested and _word_pieces and not _picture_pieces:
        _word_pieces.pop(0)()
        request()


def reset() -> None:
    """Marks all pieces as not compiled."""
    global _is_requested
    _is_requested = False
    _picture_pieces[:], _word_pieces[:] = PICTURE_PIECES + COMPARE_PIECES, WORD_PIECES
    if bpy.app.timers.is_registered(redraw):
        bpy.app.timers.unregister(redraw)


def all_pieces(film: tuple[int, int], region: tuple[int, int], view: View) -> list[Callable[[], object]]:
    """All pieces for pictures of a size; each draws into what is bound."""
    return [*(partial(piece, film, region, view) for piece in PICTURE_PIECES + COMPARE_PIECES), *WORD_PIECES]


def film_like(film: tuple[int, int]) -> tuple[int, int]:
    """Smallest picture size that drivers treat like this one."""
    width, height = (NOTHING if edge & (edge - 1) else POWER_OF_TWO for edge in film)
    return width, height


def _upload(_film: tuple[int, int], _region: tuple[int, int], view: View) -> None:
    if view.table is not None:
        texture.of_table(view)


def _show(_film: tuple[int, int], _region: tuple[int, int], view: View, one_to_one: bool, compares: bool) -> None:
    shader.show(one_to_one, compares, view.table is not None)


def _draw_nothing(film: tuple[int, int], region: tuple[int, int], view: View, one_to_one: bool, mode: int) -> None:
    """Draws an invisible picture that drivers treat like one of this size, over as many pixels as it has, or more."""
    width, height = film_like(film)
    larger = 1 if one_to_one else 2
    place = Rectangle(0.0, 0.0, larger * width, larger * height)
    picture = SimpleNamespace(image=np.zeros((height, width, 4), np.float32))
    overlay.draw(overlay.Show(region, place, place, picture, picture, mode, opacity=0.0), view)


PICTURE_PIECES: tuple[PicturePiece, ...] = (
    lambda _film, _region, _view: shader.first(),
    lambda _film, _region, view: texture.of_levels(view),
    _upload,
    partial(_show, one_to_one=True, compares=False),
    partial(_show, one_to_one=False, compares=False),
    partial(_draw_nothing, one_to_one=True, mode=overlay.SINGLE),
    partial(_draw_nothing, one_to_one=False, mode=overlay.SINGLE),
)
COMPARE_PIECES: tuple[PicturePiece, ...] = (
    partial(_show, one_to_one=True, compares=True),
    partial(_show, one_to_one=False, compares=True),
    partial(_draw_nothing, one_to_one=True, mode=overlay.DIFFERENCE),
    partial(_draw_nothing, one_to_one=False, mode=overlay.DIFFERENCE),
)
WORD_PIECES: tuple[Callable[[], object], ...] = (
    light_marks.draw_nothing,
    strokes.draw_no_strokes,
    strokes.draw_no_rectangles,
)
reset()
