"""What would hold up the first picture is done before it is asked for: everything that draws it is compiled by drawing
nothing with it, one piece at a redraw, because graphics drivers compile what is drawn for the first time.
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
"""Called with the width and height of pictures, and of the region that is drawn into."""
PAUSE_SECONDS = 0.02
"""Between redraws: what the artist does comes in between."""
NOTHING, POWER_OF_TWO = 3, 4
"""Edges of an invisible picture, in pixels. Drivers compile anew for edges that are powers of two."""

_is_wanted = False
_picture_pieces: list[PicturePiece] = []
_word_pieces: list[Callable[[], object]] = []
"""What is left of all of them."""


def want() -> None:
    """Has everything compiled that is not, in the redraws to come."""
    global _is_wanted
    _is_wanted = bool(_picture_pieces or _word_pieces)
    if _is_wanted and not bpy.app.timers.is_registered(redraw):
        bpy.app.timers.register(redraw, first_interval=PAUSE_SECONDS)


def is_wanted() -> bool:
    """Whether there is something left to compile."""
    return _is_wanted or bool(_picture_pieces)


def is_ready() -> bool:
    """Whether a picture is drawn without compiling anything."""
    return len(_picture_pieces) <= len(COMPARE_PIECES)


def are_words_ready() -> bool:
    """The same of what goes over pictures."""
    return not (_picture_pieces or _word_pieces)


def draw_picture_piece(region: tuple[int, int], view: View) -> None:
    """The next piece of what draws pictures, if any is wanted; where these are drawn, into a region of that size."""
    if _is_wanted and _picture_pieces:
        _picture_pieces.pop(0)(film_size(bpy.context.scene.render), region, view)
        want()


def draw_words_piece() -> None:
    """What draws over pictures, when there is nothing left of what draws them."""
    if _is_wanted and _word_pieces and not _picture_pieces:
        _word_pieces.pop(0)()
        want()


def reset() -> None:
    """What was compiled is gone, or never was."""
    global _is_wanted
    _is_wanted = False
    _picture_pieces[:], _word_pieces[:] = PICTURE_PIECES + COMPARE_PIECES, WORD_PIECES
    if bpy.app.timers.is_registered(redraw):
        bpy.app.timers.unregister(redraw)


def all_pieces(film: tuple[int, int], region: tuple[int, int], view: View) -> list[Callable[[], object]]:
    """All pieces for pictures of a size; each draws into what is bound."""
    return [*(partial(piece, film, region, view) for piece in PICTURE_PIECES + COMPARE_PIECES), *WORD_PIECES]


def film_like(film: tuple[int, int]) -> tuple[int, int]:
    """A size that is the same to drivers."""
    width, height = (NOTHING if edge & (edge - 1) else POWER_OF_TWO for edge in film)
    return width, height


def _upload(_film: tuple[int, int], _region: tuple[int, int], view: View) -> None:
    if view.table is not None:
        texture.of_table(view)


def _show(_film: tuple[int, int], _region: tuple[int, int], view: View, one_to_one: bool, compares: bool) -> None:
    shader.show(one_to_one, compares, view.table is not None)


def _draw_nothing(film: tuple[int, int], region: tuple[int, int], view: View, one_to_one: bool, mode: int) -> None:
    """An invisible picture, as a driver sees it like those of a size, over as many pixels as it has, or more."""
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
