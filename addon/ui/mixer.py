"""The panel of rows, and the operators on them."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
from bpy.props import BoolProperty, StringProperty

from ..apply.lights import apply_mix, show
from ..apply.writable import RefusedError
from ..core.applied_rows import AppliedRows, applied
from ..core.rows import GROUP, LIGHT, Row, is_neutral
from ..core.words import listed
from ..engine.reading.visibility import hidden_by
from ..engine.shot import shot
from ..export.current_shot import current_entry
from ..export.light_tree import light_tree
from ..export.lights import name_of
from ..live import rows
from ..live.scheduler import scheduler
from ..viewport.side_bar import elided
from .own_lights import RELUME_OT_copy_for_shot
from .panel import RelumePanel, message
from .rows import RelumeRow
from .solve import locks

WIDE = 340
"""Width of the sidebar, in pixels of an unscaled screen, from which on rows show the type of their light."""
INDENT = 0.4
"""Indent of a row for each collection around it, in the spaces of Blender's layouts."""
FOLD = 0.5
"""Indent for the triangle that a light does not have, which its collection has."""
SPACE = 6.0
"""Pixels of a space of Blender's layouts, at a scale of 1 as all below."""
MOST_LINES = 10
"""Rows that the list shows without scrolling."""
EDGES, SCROLL_BAR = 71, 18
"""Pixels of the sidebar beside the rows of a list."""
SWITCHES, TRIANGLE, DOT, ICON, MARGIN = 28, 14, 10, 20, 4
"""Pixels around a name: of checkbox and S, and of parts that not every row has."""
FIGURES = 72
"""Pixels of exposure, colour and lock. A row alone would shrink the exposure below its digits."""


def apply_to_lights(scene: bpy.types.Scene) -> list[str]:
    """Writes the mix into the lights and makes the rows neutral: the picture stays, also in shots where rows have
    values of their own. What emissive materials have cannot be written, so their row keeps it. Returns the names of
    lights whose rows keep their values, since these are of single shots alone. Raises RefusedError."""
    rows.sync(scene)
    lines = {name_of(line.block): line for line in light_tree(scene) if line.kind == LIGHT}
    named, instanced = {name for name, line in lines.items() if line.is_named}, _instanced(scene)
    shown_anyway = named if instanced is None else named & instanced
    lights = {name: line.block for name, line in lines.items()}
    common, shots = rows.plain(scene), rows.shots_with_own_values(scene, rows.present_rows(scene))
    outcome = applied(common, {entry.key: rows.plain(scene, entry.key) for entry in shots})
    apply_mix(scene, lights, *common, shown_anyway=shown_anyway, kept=outcome.kept)
    _take_applied(scene, outcome)
    rows.sync(scene)
    scheduler.read_lights(scene)
    return [row.name for row in outcome.kept]


def _take_applied(scene: bpy.types.Scene, outcome: AppliedRows) -> None:
    """Sets what is left of the rows."""
    present = rows.present_rows(scene)
    # In the order of `rows.plain`.
    present.sort(key=lambda row: row.kind == GROUP)
    for place, (row, values) in enumerate(zip(present, outcome.common, strict=True)):
        row.take(values)
        for key, found in outcome.own.items():
            if row.kind == GROUP or (found[place] == values and rows.own_values(row, key) is None):
                rows.drop_own_values(row, key)
            else:
                rows.give_own_values(row, key, found[place])


def _instanced(scene: bpy.types.Scene) -> set[str] | None:
    """Names of lights that are shown in other places than their own; None where no open shot knows them."""
    found = shot.of(scene)
    return None if found is None or found.lights.is_forgotten else found.lights.instanced


def reset(scene: bpy.types.Scene, neutral_rows: Iterable[RelumeRow] | None = None) -> None:
    """Makes rows neutral, and shows it: by default all of them, in all shots, otherwise as the current shot has
    them."""
    if neutral_rows is None:
        for row in rows.present_rows(scene):
            rows.drop_own_values(row)
            row.take(Row(row.name))
    else:
        shot = rows.current_key(scene)
        for row in neutral_rows:
            row.shown(shot).take(Row(row.name))
    scheduler.request_picture(scene)


def only_this_shot(scene: bpy.types.Scene, row: RelumeRow, only: bool) -> None:
    """Gives a row values of its own in the current shot, at first those that it has; or takes them away."""
    shot = rows.current_key(scene)
    if only:
        rows.give_own_values(row, shot, row.values(shot))
    else:
        rows.drop_own_values(row, shot)
    scheduler.request_picture(scene)


def is_hidden(scene: bpy.types.Scene, row: RelumeRow) -> bool:
    """True if a light gives no light because it is hidden, itself or by whatever holds it. Nodes and particles
    show a hidden one all the same, unless they only read it, such as its place: as long as nobody knows, they may."""
    if row.kind != LIGHT:
        return False
    found = shot.of(scene)
    shown = found.lights.shows(row.uid) if found is not None else None
    return row.hidden and not row.named if shown is None else not shown


def select_light(context: bpy.types.Context, name: str) -> str | None:
    """Makes the light of a row the active and only selected object; otherwise says why it cannot."""
    line, layer = rows.line_of(context.scene, name), context.view_layer
    obj = line and line.block
    if obj is None or layer.objects.get(obj.name) is not obj:
        return f"'{name}' is not an object of this view layer"
    if not obj.visible_get(view_layer=layer):
        return f"'{name}' is hidden in the view"
    for other in layer.objects.selected:
        other.select_set(False, view_layer=layer)
    obj.select_set(True, view_layer=layer)
    layer.objects.active = obj
    return None


def show_light(context: bpy.types.Context, name: str) -> str | None:
    """Shows the light of a row again, if it is hidden itself; says what hides it still. Raises RefusedError."""
    line = rows.line_of(context.scene, name)
    if line is None:
        return f"'{name}' is not in this scene any more"
    show(line.block, context.view_layer)
    reason = hidden_by(context, line.block)
    return None if reason is None else f"'{name}' is still hidden, {reason}"


class RELUME_OT_apply(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Write the rows into the energy and colour of the real lights and make the rows neutral; the picture stays. \
Lights that are off or not soloed keep their energy and are hidden in renders and views; a world that is off gets \
strength 0. What rows have in single shots stays, beside what was written. One undo step"""

    bl_idname = "relume.apply_to_lights"
    bl_label = "Apply to Lights"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        try:
            kept = apply_to_lights(context.scene)
        except RefusedError as error:
            for reason in error.reasons:
                self.report({"ERROR"}, f"Nothing was written: {reason}")
            return {"CANCELLED"}
        if kept:
            self.report({"INFO"}, f"Still in rows, as only single shots have that light: {listed(kept)}")
        return {"FINISHED"}


class RELUME_OT_read(bpy.types.Operator):  # noqa: N801
    """Make all rows neutral, so that the picture shows the lights as they are in the scene"""

    bl_idname = "relume.read_from_lights"
    bl_label = "Reset to Lights"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        reset(context.scene)
        return {"FINISHED"}


class RELUME_OT_reset_row(bpy.types.Operator):  # noqa: N801
    """Make this row neutral: on, no solo, exposure 0, multiplier 1, white"""

    bl_idname = "relume.reset_row"
    bl_label = "Reset Row"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        row = rows.active_row(context.scene)
        if row is None:
            return {"CANCELLED"}
        reset(context.scene, [row])
        return {"FINISHED"}


class RELUME_OT_only_this_shot(bpy.types.Operator):  # noqa: N801
    """Give this row values of its own in the current shot. All other shots keep the common ones"""

    bl_idname = "relume.only_this_shot"
    bl_label = "Only This Shot"
    bl_options = {"REGISTER", "UNDO"}

    only: BoolProperty(
        name="Only This Shot", description="Own values, or those of all shots", default=True, options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, context, properties):
        """The tooltip."""
        entry = current_entry(context.scene)
        if entry is None:
            return cls.__doc__
        if properties.only:
            return f"Give this row values of its own in the shot '{entry.name}'. All other shots keep the common ones"
        return f"Give this row the common values in the shot '{entry.name}' again. Its own ones are forgotten"

    @classmethod
    def poll(cls, context):
        """True if a row is chosen, and the scene's camera and frame are those of a listed shot."""
        return rows.active_row(context.scene) is not None and current_entry(context.scene) is not None

    def execute(self, context):
        """Called by Blender."""
        only_this_shot(context.scene, rows.active_row(context.scene), self.only)
        return {"FINISHED"}


class _OnLight:
    """Mix-in of operators on the light of a row."""

    bl_options = {"REGISTER", "UNDO"}
    light: StringProperty(name="Light", description="Name of the light object", options={"SKIP_SAVE"})


class RELUME_OT_select_light(_OnLight, bpy.types.Operator):  # noqa: N801
    """Select the light object of this row, and nothing else"""

    bl_idname = "relume.select_light"
    bl_label = "Select Light"

    def execute(self, context):
        """Called by Blender."""
        problem = select_light(context, self.light)
        if problem:
            self.report({"WARNING"}, problem)
        return {"CANCELLED"} if problem else {"FINISHED"}


class RELUME_OT_show_light(_OnLight, bpy.types.Operator):  # noqa: N801
    """This light is hidden. Show it again, in renders and views"""

    bl_idname = "relume.show_light"
    bl_label = "Show Light"

    def execute(self, context):
        """Called by Blender."""
        try:
            problem = show_light(context, self.light)
        except RefusedError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if problem:
            self.report({"WARNING"}, problem)
        return {"FINISHED"}


class RELUME_UL_rows(bpy.types.UIList):  # noqa: N801
    """Rows in the order of the collections; those of closed groups are left out."""

    def draw_item(self, context, layout, _data, row, _icon, _active_data, _active_property):
        """Called by Blender for the rows in sight only."""
        mix, width = context.scene.relume_mix, context.region.width / (context.preferences.system.ui_scale or 1.0)
        scrolls = len(mix.rows) > MOST_LINES
        room = max(width - EDGES - SCROLL_BAR * scrolls, 2 * FIGURES) - FIGURES
        split = layout.split(factor=room / (room + FIGURES), align=True)
        line = split.row(align=True)
        # Switches stand in columns: between indent and name they would hide which row is inside of which.
        shot = rows.current_key(context.scene)
        shown = row.shown(shot)
        cell = _cell(line, 0.75)
        if is_hidden(context.scene, row):
            cell.operator("relume.show_light", text="", icon="HIDE_ON", emboss=False).light = row.name
        else:
            cell.prop(shown, "on", text="")
        _cell(line, 0.65).prop(row, "solo", text="S", toggle=True)
        _draw_name(line, row, row.depth if mix.grouped else 0, room - SWITCHES - MARGIN, width > WIDE, shot)
        line = split.row(align=True)
        # The edges of a number's field would take the place of its digits.
        line.prop(shown, "exposure", text="", emboss=False)
        _cell(line, 0.5).prop(shown, "color", text="")
        locks.draw_lock(_cell(line, 0.7), context.scene, row)

    def filter_items(self, _context, data, _property):
        """Called by Blender: which rows are shown, and in which order."""
        items = data.rows
        order = _column(items, "order")
        shown = shown_rows(items, order, data.search or self.filter_name, data.grouped)
        return [self.bitflag_filter_item if show else 0 for show in shown], order


def shown_rows(items, order: list[int], search: str = "", grouped: bool = True) -> list[bool]:
    """The rows that the list shows: those of open groups; while searching, those with the words in their name. Groups
    of a single light, and all of them where `grouped` is not set, are left out as long as they change nothing."""
    present, depth, is_open = _column(items, "present"), _column(items, "depth"), _column(items, "open")
    if search:
        words = search.casefold()
        return [there and words in row.name.casefold() for there, row in zip(present, items, strict=True)]
    shown, closed_at = [False] * len(order), None
    for place in sorted(range(len(order)), key=order.__getitem__):
        row = items[place]
        is_left_out = row.kind == GROUP and (row.single or not grouped) and is_neutral(row.values())
        if not present[place] or is_left_out or (grouped and closed_at is not None and depth[place] > closed_at):
            continue
        shown[place] = True
        # Only groups have a fold, and only they can have something deeper below.
        closed_at = None if is_open[place] else depth[place]
    return shown


def _draw_name(line, row: RelumeRow, depth: int, room: float, has_icon: bool, shot: str) -> None:
    """Draws all between the switches of a row and its exposure, in `room` pixels at a scale of 1."""
    if depth:
        indent = INDENT * depth + (0.0 if row.kind == GROUP else FOLD)
        line.separator(factor=indent)
        room -= SPACE * indent
    if row.kind == GROUP:
        icon = "DISCLOSURE_TRI_DOWN" if row.open else "DISCLOSURE_TRI_RIGHT"
        _cell(line, 0.7).prop(row, "open", text="", icon=icon, emboss=False)
        room -= TRIANGLE
    # A dot, as values that are set in the details alone would otherwise not be seen.
    shown, is_own = row.shown(shot), rows.own_values(row, shot) is not None
    has_dot = shown.multiplier != 1.0 or shown.use_kelvin
    name = elided(row.name, room - DOT * has_dot - ICON * (has_icon + is_own))
    line.label(text=name, icon=row.icon if has_icon else "NONE")
    if is_own:
        _cell(line, 0.8).label(text="", icon="OUTLINER_OB_CAMERA")
    if has_dot:
        _cell(line, 0.5).label(text="", icon="DOT")


def _column(items, name: str) -> list:
    values = [0] * len(items)
    items.foreach_get(name, values)
    return values


def _cell(line, width: float):
    cell = line.row(align=True)
    cell.ui_units_x = width
    return cell


class RELUME_PT_mixer(RelumePanel, bpy.types.Panel):  # noqa: N801
    """A row for every light"""

    bl_idname = "RELUME_PT_mixer"
    bl_label = "Lights"
    bl_order = 10

    def draw(self, context):
        """Called by Blender."""
        layout, mix = self.layout, context.scene.relume_mix
        line = layout.row(align=True)
        line.prop(mix, "search", text="", icon="VIEWZOOM")
        line.prop(mix, "grouped", text="", icon="OUTLINER_COLLECTION")
        lines = max(3, min(len(mix.rows), MOST_LINES))
        layout.template_list("RELUME_UL_rows", "", mix, "rows", mix, "active", rows=lines)
        row = rows.active_row(context.scene)
        if row is not None:
            _draw_details(layout.box(), context.scene, row)
        line = layout.row(align=True)
        line.operator("relume.apply_to_lights", icon="CHECKMARK")
        line.operator("relume.read_from_lights", icon="LOOP_BACK")


def _draw_details(box, scene: bpy.types.Scene, row: RelumeRow) -> None:
    line = box.row(align=True)
    line.label(text=row.name, icon=row.icon)
    if row.kind == LIGHT:
        line.operator("relume.select_light", text="", icon="RESTRICT_SELECT_OFF").light = row.name
    line.operator("relume.reset_row", text="", icon="LOOP_BACK")
    shown = _draw_shots(box, scene, row)
    column = box.column(align=True)
    column.prop(shown, "exposure", slider=True)
    column.prop(shown, "multiplier")
    line = box.row(align=True)
    line.prop(shown, "color", text="")
    line.prop(shown, "use_kelvin", toggle=True)
    if shown.use_kelvin:
        line.prop(shown, "kelvin", text="")
    locks.draw_parameters(box, scene, row)


def _draw_shots(box, scene: bpy.types.Scene, row: RelumeRow):
    """Draws for which shots the values below are; returns these."""
    entry = current_entry(scene)
    own = rows.own_values(row, entry.key) if entry is not None else None
    if entry is not None and (len(scene.relume_shots.items) > 1 or own is not None):
        line = box.row(align=True)
        button = line.operator(
            "relume.only_this_shot", text=f"Only in {entry.name}", icon="OUTLINER_OB_CAMERA", depress=own is not None
        )
        button.only = own is None
        if row.kind == LIGHT:
            line.operator("relume.copy_for_shot", text="", icon="DUPLICATE").light = row.name
    others = [other.name for other in rows.shots_with_own_values(scene, [row]) if other != entry]
    if others:
        message(box, f"Other values in {', '.join(others)}", "INFO")
    return own or row


CLASSES = (
    RELUME_OT_apply,
    RELUME_OT_read,
    RELUME_OT_reset_row,
    RELUME_OT_only_this_shot,
    RELUME_OT_copy_for_shot,
    RELUME_OT_select_light,
    RELUME_OT_show_light,
    RELUME_UL_rows,
    RELUME_PT_mixer,
)


def register():
    """Adds panel and operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
