"""Thumbnails of looks are their pictures, small, under the view of the scene."""

import numpy as np
import pytest

from addon.live.scheduler import scheduler
from addon.ui import looks, thumbnails
from addon.ui.start import start
from addon.viewport import view_table
from fake_live import FakeLive


def test_a_thumbnail_is_the_picture_under_the_scenes_view(rigged):
    rigged.view_settings.view_transform = "AgX"
    start(rigged)
    (live,) = FakeLive.made
    live.show()
    image = np.ones((300, 480, 4), np.float32)
    image[150:, :, 0] = 4.0  # The upper half is red.
    live.newest.image = image
    scheduler.tick()
    entry = looks.snapshot(rigged)
    pixels = thumbnails.decode(entry.thumbnail)
    assert pixels.shape == (100, 160, 3)
    assert pixels[10, 10].tolist() == [197, 197, 197], "1.0 in AgX"
    assert pixels[90, 10, 0] > 220 > pixels[90, 10, 1]
    assert len(entry.thumbnail) < 4000
    assert thumbnails.icon(entry.uid, entry.thumbnail) >= 0 and thumbnails.icon("other", "") == 0


@pytest.mark.parametrize("size", [(1, 1), (3, 1000), (1000, 3), (540, 960)])
def test_thumbnails_of_odd_sizes(rigged, size):
    image = np.full((*size, 4), np.inf, np.float32)
    image[0, 0] = np.nan
    height, width = thumbnails.decode(thumbnails.encode(rigged, image)).shape[:2]
    assert 1 <= width <= thumbnails.WIDTH and height >= 1


def test_thumbnails_in_a_known_view_are_the_same(rigged):
    image = np.ones((100, 160, 4), np.float32)
    image[..., :3] = np.exp2(np.linspace(-6.0, 4.0, 160))[:, None]
    slow = thumbnails.decode(thumbnails.encode(rigged, image))
    view_table.complete(rigged)
    quick = thumbnails.decode(thumbnails.encode(rigged, image))
    view_table.clear()
    assert np.abs(slow.astype(int) - quick).max() <= 1 and slow.std() > 20
