"""Blender add-on: fills and cleans the action of an armature by the program posing.

Rotations and animated locations go through a BVH file in a temporary folder: as A q A^-1, where
q is what the F-curves say and A the bone's rest pose in the world, y up. Frames that the program
leaves as they are keep the old values, in a new action.
"""

import json
import math
import shutil
import subprocess
import tempfile
import textwrap
from pathlib import Path

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty
from mathutils import Euler, Matrix, Quaternion, Vector

bl_info = {
    "name": "posing", "version": (0, 2, 0), "blender": (4, 2, 0), "category": "Animation",
    "location": "3D View > Sidebar > posing", "description": "Fills gaps of motion capture, removes noise",
}

MISSING = "posing_missing"  # of an action, as JSON: [[bone, first frame, last frame], ...]
KEPT, SMOOTHED, FILLED, LEFT = range(4)
COLORS = [(0.2, 0.7, 0.25), (0.95, 0.8, 0.1), (0.6, 0.3, 0.9), (0.85, 0.1, 0.1)]
KEY_TYPES = ["KEYFRAME", "BREAKDOWN", "EXTREME", "KEYFRAME"]
Y_UP = Matrix.Rotation(-math.pi / 2, 3, "X").to_quaternion()
CURVES = ('["posing_changed"]', '["posing_error"]')  # in degrees


class Refused(Exception):
    """One line for the status bar."""


def preferences(context):
    return context.preferences.addons[__name__].preferences


def curves_of(action, data):
    """What holds the F-curves and the groups: a channel bag, before Blender 4.4 the action."""
    if not hasattr(data, "action_slot"):
        return action
    for strip in (strip for layer in action.layers for strip in layer.strips):
        if data.action_slot and strip.channelbag(data.action_slot):
            return strip.channelbag(data.action_slot)
    raise Refused(f"the action {action.name} has no channels of this armature")


def rotation(mode, values):
    if mode == "QUATERNION":
        return Quaternion(values).normalized()
    if mode == "AXIS_ANGLE":
        return Quaternion(values[1:], values[0])
    return Euler(values, mode).to_quaternion()


def channels(mode, turn, near):
    """The rotation in the bone's own mode, of all ways to say it the one nearest to `near`."""
    if mode == "QUATERNION":
        return tuple(-turn if turn.dot(Quaternion(near)) < 0 else turn)
    if mode == "AXIS_ANGLE":
        axis, angle = turn.to_axis_angle()
        sign = math.copysign(1, axis.dot(Vector(near[1:])))
        return (near[0] + math.remainder(sign * angle - near[0], math.tau), *(sign * axis))
    return tuple(turn.to_euler(mode, Euler(near, mode)))


def degrees_between(one, other):
    turn = one.conjugated() @ other  # Quaternion.angle is off by 0.03 degrees near 0
    return math.degrees(2 * math.atan2(Vector(turn[1:]).length, abs(turn[0])))


class Joint:
    """A bone, what its F-curves say in each frame, and its columns in the file."""

    def __init__(self, take, bone, column):
        head = bone.bone.head_local - (bone.parent.bone.head_local if bone.parent else Vector())
        self.bone, self.mode, self.scale = bone, bone.rotation_mode, take.scale
        self.axes = take.world @ bone.bone.matrix_local.to_quaternion()
        self.offset = take.world @ head * take.scale
        self.missing = {at for name, a, b in take.marks if name == bone.name for at in range(a, b + 1)}
        self.turns = "rotation_" + ("euler" if len(self.mode) == 3 else self.mode.lower())
        self.values, self.animated = {}, set()
        for name in ("location", self.turns):
            curves = [take.curves.get((f"{bone.path_from_id()}.{name}", i)) for i in range(4)]
            rest = [[value] * len(take.frames) for value in getattr(bone, name)]
            columns = [[c.evaluate(f) for f in take.frames] if c else r for c, r in zip(curves, rest)]
            self.values[name] = list(zip(*columns))
            self.animated |= {name} if any(curves) else set()
        self.moves = not bone.parent or ("location" in self.animated and not bone.bone.use_connect)
        self.place = range(column, column + 3 * self.moves)
        self.angles = range(self.place.stop, self.place.stop + 3)

    def to_file(self, at, frame):
        if frame in self.missing:
            return ["nan"] * (len(self.place) + 3)
        place = self.offset + self.axes @ Vector(self.values["location"][at]) * self.scale
        turn = self.axes @ rotation(self.mode, self.values[self.turns][at]) @ self.axes.conjugated()
        x, y, z = map(math.degrees, turn.to_euler("YXZ"))  # BVH's Zrotation Xrotation Yrotation
        return [f"{number:.6f}" for number in [*place] * self.moves + [z, x, y]]

    def from_file(self, name, numbers):
        numbers = Vector(map(float, numbers))
        if name == "location":
            return self.axes.conjugated() @ (numbers - self.offset) / self.scale
        z, x, y = map(math.radians, numbers)
        return (self.axes.conjugated() @ Euler((x, y, z), "YXZ").to_quaternion() @ self.axes).normalized()


class Take:
    """The action of an armature as a BVH file, in centimeters, y up."""

    def __init__(self, context):
        rig, scene = context.object, context.scene
        self.data, self.action = rig.animation_data, rig.animation_data.action
        curves = curves_of(self.action, self.data).fcurves
        self.curves = {(curve.data_path, curve.array_index): curve for curve in curves if not curve.mute}
        self.marks = json.loads(self.action.get(MISSING, "[]"))
        for name in {name for name, *_ in self.marks} - set(rig.pose.bones.keys()):
            raise Refused(f"frames of {name} are marked as missing, and there is no such bone")
        self.frames = range(math.floor(self.action.frame_range[0]), math.ceil(self.action.frame_range[1]) + 1)
        self.world = Y_UP @ rig.matrix_world.to_quaternion()
        self.scale = max(map(abs, rig.matrix_world.to_scale())) * scene.unit_settings.scale_length * 100
        roots = [bone for bone in rig.pose.bones if not bone.parent]
        padding = ["0"] * 6 * (len(roots) > 1)  # one root above several
        self.joints, self.header, self.width = [], ["HIERARCHY"], len(padding)
        if padding:
            self.open("ROOT", rig.name, Vector(), True)
        for bone in roots:
            self.add(bone, "JOINT" if padding else "ROOT")
        self.header += ["}"] * bool(padding)
        lines = [[joint.to_file(*at) for joint in self.joints] for at in enumerate(self.frames)]
        self.rows = [sum(numbers, padding) for numbers in lines]
        self.header += ["MOTION", f"Frames: {len(lines)}"]
        self.header.append(f"Frame Time: {scene.render.fps_base / scene.render.fps:.9f}")
        self.text = "\n".join([*self.header, *map(" ".join, self.rows), ""])

    def open(self, word, name, offset, moves):
        places = "6 Xposition Yposition Zposition" if moves else "3"
        self.header += [f"{word} {'_'.join(name.split())}", "{", "OFFSET {:.6f} {:.6f} {:.6f}".format(*offset)]
        self.header.append(f"CHANNELS {places} Zrotation Xrotation Yrotation")

    def add(self, bone, word):
        joint = Joint(self, bone, self.width)
        self.joints.append(joint)
        self.width = joint.angles.stop
        self.open(word, bone.name, joint.offset, joint.moves)
        for child in bone.children:
            self.add(child, "JOINT")
        if not bone.children:
            end = self.world @ (bone.bone.tail_local - bone.bone.head_local) * self.scale
            self.header += ["End Site", "{", "OFFSET {:.6f} {:.6f} {:.6f}".format(*end), "}"]
        self.header.append("}")

    def span(self, frames):  # as those of the timeline
        return f"{self.frames[frames[0]]} to {self.frames[frames[1] - 1]}"


def run(context, take, folder, command, *arguments):
    """Runs the program on the take. Its last line is the error if it fails."""
    program = bpy.path.abspath(preferences(context).program) or shutil.which("posing")
    if not program:
        raise Refused("no program posing on PATH; set its path in Preferences > Add-ons > posing")
    Path(folder, "take.bvh").write_text(take.text, encoding="utf-8")
    hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # no console on Windows
    options = {"cwd": folder, "stdin": subprocess.DEVNULL, "capture_output": True, "creationflags": hidden}
    try:
        done = subprocess.run([program, command, "take.bvh", *arguments], **options)
    except OSError as error:
        raise Refused(f"{program}: {error.strerror}") from error
    if done.returncode not in (0, 3):  # 3: findings
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise Refused(lines[-1] if lines else f"{program} ended with code {done.returncode}")
    return done.stdout


def bake(bag, group, path, first, columns, kinds=None):
    """A key in each frame, of each column an F-curve; the last of these."""
    for index, values in enumerate(columns):
        curve = bag.fcurves.find(path, index=index) or bag.fcurves.new(path, index=index)
        for modifier in list(curve.modifiers):  # they are in the values
            curve.modifiers.remove(modifier)
        curve.mute, keys = False, curve.keyframe_points
        keys.clear()
        keys.add(len(values))
        keys.foreach_set("co", [x for at, value in enumerate(values) for x in (first + at, value)])
        for at, key in enumerate(keys):
            key.interpolation, key.type = "LINEAR", KEY_TYPES[kinds[at] if kinds else KEPT]
        if curve.group != group:  # else it is an error
            curve.group = group
        curve.update()
    return curve


def cleaned(take, after, record):
    """Makes the new action, and lines that say what was done."""
    notes = (record.get("rotations") or {}).get("joints", [])
    smoothed = [f"{note['joint']}: smoothed" for note in notes if "smoothed" in note]
    take.action.use_fake_user = True  # else it is not saved
    slot, action, lines = getattr(take.data, "action_slot", None), take.action.copy(), []
    action.name = f"{take.action.name} cleaned"
    action.pop(MISSING, None)
    take.data.action = action
    if slot:
        take.data.action_slot = next(s for s in action.slots if s.identifier == slot.identifier)
    bag = curves_of(action, take.data)
    for joint in (joint for joint in take.joints if joint.animated or joint.missing):
        bone, first, worst = joint.bone, take.frames[0], KEPT
        group = bag.groups.get(bone.name) or bag.groups.new(bone.name)
        changed, errors = [0.0] * len(after), [0.0] * len(after)
        for name, columns in (("location", joint.place), (joint.turns, joint.angles)):
            own = [note for note in notes if set(note["channels"]) & set(columns)]
            pops = [at for note in own for pop in note.get("pops", []) for at in range(*pop)]
            lines += [f"{bone.name}: pop in {take.span(p)} bridged" for n in own for p in n.get("pops", [])]
            for gap in (gap for note in own for gap in note.get("gaps", [])):
                error, unit = gap["error"] or 0.0, "cm" if name == "location" else "°"
                about = f", error about {error:.1f} {unit}" if error else ""
                lines.append(f"{bone.name}: {name} in {take.span(gap['frames'])} filled{about}")
                if unit == "°":
                    errors[slice(*gap["frames"])] = [error] * len(range(*gap["frames"]))
            values, kinds = list(joint.values[name]), []
            for at, rows in enumerate(zip(take.rows, after)):
                old, new = ([row[i] for i in columns] for row in rows)
                change = FILLED if "nan" in old or at in pops else SMOOTHED
                kinds.append(LEFT if "nan" in new else KEPT if old == new else change)
                if kinds[at] not in (SMOOTHED, FILLED):
                    continue
                old, values[at] = values[at], joint.from_file(name, new)
                if name != "location":
                    changed[at] = degrees_between(rotation(joint.mode, old), values[at])
                    near = values[at - 1] if kinds[at] == FILLED and at else old
                    values[at] = channels(joint.mode, values[at], near)
            worst = max(worst, *kinds)
            if LEFT in kinds:
                lines.insert(0, f"{bone.name}: {kinds.count(LEFT)} frames stay missing, with the old {name}")
            if SMOOTHED in kinds or FILLED in kinds:
                bake(bag, group, f"{bone.path_from_id()}.{name}", first, zip(*values), kinds)
        for name, values in zip(CURVES, (changed, errors)):
            bone[name[2:-2]] = 0.0
            curve = bake(bag, group, bone.path_from_id() + name, first, [values])
            curve.color_mode, curve.color = "CUSTOM", COLORS[worst]
        bone.color.palette = group.color_set = "CUSTOM"
        for shades in (bone.color.custom, group.colors):
            shades.normal = COLORS[worst]
            shades.select = shades.active = [0.5 + shade / 2 for shade in COLORS[worst]]
    return action.name, lines + smoothed


class OnAction:
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        data = context.object and context.object.type == "ARMATURE" and context.object.animation_data
        return bool(data and data.action)

    def execute(self, context):
        try:
            with tempfile.TemporaryDirectory(prefix="posing-") as folder:
                name, lines = self.work(context, folder)
        except Refused as line:
            self.report({"ERROR"}, str(line))
            return {"CANCELLED"}
        context.scene["posing"] = "\n".join([f"{name}:", *(lines or ["nothing found"])])
        level = "WARNING" if "stay missing" in context.scene["posing"] else "INFO"
        self.report({level}, f"{name}: {len(lines)} lines in the panel")
        return {"FINISHED"}


class POSING_OT_clean(OnAction, bpy.types.Operator):
    """Fill what is missing and remove noise and pops, in a new action"""
    bl_idname, bl_label = "posing.clean", "Clean"

    def work(self, context, folder):
        settings, take, out = preferences(context), Take(context), Path(folder, "cleaned.bvh")
        flags = ["--no-smooth"] if settings.no_smooth else [f"--noise-limit={settings.noise_limit:.6g}deg"]
        flags += [f"--max-gap={settings.max_gap:.6g}"] * (settings.max_gap > 0)
        run(context, take, folder, "clean", "-o", out.name, *flags)
        motion = out.read_text(encoding="utf-8").split("\nMOTION\n")[1]
        after = [line.split() for line in motion.splitlines()[2:]]
        if [len(row) for row in after] != [len(row) for row in take.rows]:
            raise Refused("the result does not have the frames and channels of the action")
        record = json.loads(Path(folder, "cleaned.bvh.json").read_text(encoding="utf-8"))
        return cleaned(take, after, record)


class POSING_OT_audit(OnAction, bpy.types.Operator):
    """Say what is wrong with the action, and change nothing"""
    bl_idname, bl_label = "posing.audit", "Audit"

    def work(self, context, folder):
        take, lines = Take(context), []
        report = json.loads(run(context, take, folder, "audit", "--json"))
        for finding in (finding for found in report[0]["takes"] for finding in found["findings"]):
            frames = finding.get("frames")
            lines.append(finding["what"] + (f"; timeline {take.span(frames)}" if frames else ""))
        return take.action.name, lines


class POSING_OT_mark(OnAction, bpy.types.Operator):
    """Take frames of the selected bones for missing; Clean fills them"""
    bl_idname, bl_label = "posing.mark_missing", "Take for missing"
    first: IntProperty(name="From frame")
    last: IntProperty(name="To frame")
    forget: BoolProperty(name="Forget all earlier marks", options={"SKIP_SAVE"})

    def invoke(self, context, event):
        return context.window_manager.invoke_props_dialog(self)

    def work(self, context, folder):
        action, bones = context.object.animation_data.action, context.object.pose.bones
        names = [b.name for b in bones if (b if hasattr(b, "select") else b.bone).select]  # 5: the pose's
        if not self.forget and (not names or self.last < self.first):
            raise Refused("select bones, and a last frame that is not before the first")
        marks = [] if self.forget else json.loads(action.get(MISSING, "[]"))
        marks += [[name, self.first, self.last] for name in names if self.last >= self.first]
        action[MISSING] = json.dumps(marks)
        return action.name, [f"{name}: {first} to {last} is missing" for name, first, last in marks]


class POSING_PT_panel(bpy.types.Panel):
    bl_label = bl_category = "posing"
    bl_space_type, bl_region_type = "VIEW_3D", "UI"

    def draw(self, context):
        for name in ("max_gap", "noise_limit", "no_smooth"):
            self.layout.prop(preferences(context), name)
        for name in ("mark_missing", "audit", "clean"):
            self.layout.operator(f"posing.{name}")
        lines = context.scene.get("posing", "").split("\n")
        for part in (part for line in lines for part in textwrap.wrap(line, 46)):
            self.layout.label(text=part)


class POSING_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    program: StringProperty(name="Program posing", subtype="FILE_PATH", description="Empty: found on PATH")
    max_gap: FloatProperty(name="Longest gap (s)", min=0, description="Longer gaps stay; 0: no limit")
    noise_limit: FloatProperty(name="Noise limit (°)", default=0.25, min=0, description="Smooth above it")
    no_smooth: BoolProperty(name="No smoothing", description="Only fill gaps and bridge pops")

    def draw(self, context):
        self.layout.prop(self, "program")


CLASSES = [POSING_AP_preferences, POSING_PT_panel, POSING_OT_clean, POSING_OT_audit, POSING_OT_mark]
register, unregister = bpy.utils.register_classes_factory(CLASSES)
