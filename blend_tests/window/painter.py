"""Actions of an artist with the scribble brush, as functions for scenarios."""

import numpy as np
from artist import WORK_SECONDS, Artist, addon


class Painter(Artist):
    """An artist with the scribble brush."""

    @property
    def settings(self):
        """Settings of solving in the scene."""
        return self.scene.relume_solve

    @property
    def strokes(self):
        """The strokes that are kept."""
        return addon("engine.solve.request").strokes_of(self.scene)

    @property
    def tool(self):
        """The tool in hand."""
        return self.driver.window.workspace.tools.from_space_view3d_mode("OBJECT", create=False).idname

    def at(self, x, y):
        """The place in the window of fractions of the picture, from its top left corner."""
        frame, region = self._frame(), self.driver.region()
        return region.x + frame.left + x * frame.width, region.y + frame.top - y * frame.height

    def line(self, start, end, count=12):
        """Places along a line in the picture."""
        return [self.at(*(np.array(start) + (np.array(end) - start) * i / (count - 1))) for i in range(count)]

    def paint(self, meaning, start, end, button="LEFTMOUSE", **modifiers):
        """One stroke by the mouse."""
        self.settings.meaning = meaning
        yield from self.driver.sweep(self.line(start, end), button, **modifiers)
        yield from self.driver.drawn()

    def values(self):
        """All that solving could write to lights."""
        return {
            obj.name: (obj.data.energy, tuple(obj.data.color), tuple(map(tuple, obj.matrix_world)), obj.hide_render)
            for obj in self.scene.objects
            if obj.type == "LIGHT"
        }

    def gain_since(self, before, weights):
        """How many times as much light a part of the picture has as in an earlier picture; weights [height, width],
        top row first."""
        weights = weights[::-1, :, None]
        return (weights * self.picture()[..., :3]).sum() / (weights * before[..., :3]).sum()

    def error(self, wanted):
        """Mean difference of the picture from another, as a share of that."""
        wanted = wanted[..., :3]
        return float(np.abs(self.picture()[..., :3] - wanted).mean() / wanted.mean())

    def until_shown(self):
        """Waits until lights that a script has changed are in the picture, and it is the best that there is."""
        yield from self.driver.wait(0.5)
        yield from self.until_settled()

    def solve(self):
        """Presses Enter over the view and waits for the end."""
        solving = addon("engine.solve.solving")
        yield from self.driver.move_mouse(*self.at(0.5, 0.5))
        yield from self.driver.press("RET")
        found = solving.running(self.scene)
        self.driver.check(found is not None, "Enter begins to solve")
        seconds = yield from self.driver.until(
            lambda: solving.running(self.scene) is None, lambda: f"the end of solving; {found.progress}", WORK_SECONDS
        )
        self.driver.record("time to solve", seconds, "s")
