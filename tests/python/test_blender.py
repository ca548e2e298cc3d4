"""The Blender add-on, in Blender as a module: what it changes, and what it leaves."""

import importlib.util
import math
import os
import random
import shutil
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="no bpy (pip install bpy==4.5.*)")
from mathutils import Euler, Quaternion, Vector  # noqa: E402

ADDON = Path(__file__).resolve().parents[2] / "testdata/examples/blender/posing.py"
FIRST, COUNT = 11, 240
GAP = range(100, 121)
MODES = {"hips": "QUATERNION", "spine": "XYZ", "arm": "ZXY", "fore arm": "AXIS_ANGLE"}
GREEN, YELLOW, PURPLE = (0.2, 0.7, 0.25), (0.95, 0.8, 0.1), (0.6, 0.3, 0.9)


@pytest.fixture(scope="module")
def addon():
    # Not as posing, which may be the package.
    spec = importlib.util.spec_from_file_location("posing_blender", ADDON)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.register()
    bpy.context.preferences.addons.new().module = "posing_blender"
    yield module
    module.unregister()


@pytest.fixture
def preferences(addon):
    chosen = Path(os.environ.get("POSING_BIN") or shutil.which("posing") or "")
    chosen = chosen / "posing" if chosen.is_dir() else chosen
    if not chosen.is_file():
        pytest.skip("no program posing: set POSING_BIN")
    preferences = bpy.context.preferences.addons["posing_blender"].preferences
    preferences.program = str(chosen)
    for name in ("max_gap", "noise_limit", "no_smooth"):
        preferences.property_unset(name)
    return preferences


def truth(bone, frame):
    at = (frame - FIRST) / 30
    turns = {
        "hips": (0.1 * math.sin(2 * at), 0.2 * math.sin(at), 0.1),
        "spine": (0.3 * math.sin(2.1 * at), 0.2 * math.cos(2 * at), 0.1 * math.sin(at)),
        "arm": (0.8 * math.sin(2.5 * at), 0.4 * math.cos(2.5 * at), 0.3),
        "fore arm": (0.5 + 0.4 * math.sin(2.5 * at + 0.4), 0, 0),
    }
    return Euler(turns[bone]).to_quaternion()


def place(frame):
    return Vector((0.1 * math.sin(frame / 20), 0.02 * math.cos(frame / 7), 0.01 * (frame - FIRST)))


def value(mode, turn):
    if mode == "QUATERNION":
        return "rotation_quaternion", turn
    if mode == "AXIS_ANGLE":
        axis, angle = turn.to_axis_angle()
        return "rotation_axis_angle", (angle, *axis)
    return "rotation_euler", turn.to_euler(mode)


def rotation(mode, values):
    if mode == "QUATERNION":
        return Quaternion(values).normalized()
    if mode == "AXIS_ANGLE":
        return Quaternion(values[1:], values[0])
    return Euler(values, mode).to_quaternion()


def armature(noisy=()):
    """A hips, a spine and an arm that move; the noise of a bone is 1.5 degrees an axis."""
    scene = bpy.context.scene
    if bpy.context.object:
        bpy.ops.object.mode_set(mode="OBJECT")
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.armatures, *bpy.data.actions])
    scene.pop("posing", None)
    scene.render.fps = 30
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    rig.rotation_euler = (0.3, 0, 1)
    rig.scale = (0.5, 0.5, 0.5)
    bpy.context.view_layer.update()
    bpy.ops.object.mode_set(mode="EDIT")
    parent = None
    heads = [(0, 0, 1.9), (0, 0.1, 2.2), (0.4, 0, 2.8), (1, 0.1, 2.8), (1.5, 0, 2.7)]
    for name, head, tail in zip(MODES, heads, heads[1:]):
        bone = data.edit_bones.new(name)
        bone.head, bone.tail, bone.roll = head, tail, 0.4
        bone.parent, parent = parent, bone
    bpy.ops.object.mode_set(mode="POSE")
    draw = random.Random(7)
    for frame in range(FIRST, FIRST + COUNT):
        for name, mode in MODES.items():
            turn = truth(name, frame)
            if name in noisy:
                turn = turn @ Euler([math.radians(draw.gauss(0, 1.5)) for _ in range(3)]).to_quaternion()
            if frame in GAP and name == "arm":
                turn = Quaternion()
            bone = rig.pose.bones[name]
            bone.rotation_mode = mode
            path, values = value(mode, turn)
            setattr(bone, path, values)
            bone.keyframe_insert(path, frame=frame)
        rig.pose.bones["hips"].location = place(frame)
        rig.pose.bones["hips"].keyframe_insert("location", frame=frame)
    return rig


def mark(rig, *names):
    for bone in rig.pose.bones:
        chosen = bone if hasattr(bone, "select") else bone.bone
        chosen.select = bone.name in names
    bpy.ops.posing.mark_missing(first=GAP[0], last=GAP[-1])


def curves(addon, rig, action=None):
    bag = addon.curves_of(action or rig.animation_data.action, rig.animation_data)
    return {(curve.data_path, curve.array_index): curve for curve in bag.fcurves}


def sample(of, path, size, frame):
    return [of[path, index].evaluate(frame) for index in range(size)]


def turns(of, name):
    mode = MODES[name]
    path, values = value(mode, Quaternion())
    path = f'pose.bones["{name}"].{path}'
    return {
        frame: rotation(mode, sample(of, path, len(values), frame))
        for frame in range(FIRST, FIRST + COUNT)
    }


def changed(of, name, property="posing_changed"):
    curve = of[f'pose.bones["{name}"]["{property}"]', 0]
    return {frame: curve.evaluate(frame) for frame in range(FIRST, FIRST + COUNT)}


def content(addon, rig, action):
    of = curves(addon, rig, action)
    return {key: [tuple(k.co) for k in curve.keyframe_points] for key, curve in of.items()}


def near(one, other):
    return all(abs(a - b) < 1 / 255 for a, b in zip(one, other))


def test_a_marked_gap_is_filled_and_all_else_stays(addon, preferences):
    rig = armature()
    old = rig.animation_data.action
    mark(rig, "arm")
    before = content(addon, rig, old)
    assert bpy.ops.posing.clean() == {"FINISHED"}

    new = rig.animation_data.action
    assert new != old and new.name == f"{old.name} cleaned" and old.use_fake_user
    assert content(addon, rig, old) == before and old["posing_missing"]
    assert "posing_missing" not in new
    of = curves(addon, rig)
    for name, mode in MODES.items():
        assert rig.pose.bones[name].rotation_mode == mode
        for frame, turn in turns(of, name).items():
            error = addon.degrees_between(truth(name, frame), turn)
            is_filled = name == "arm" and frame in GAP
            assert error < (5 if is_filled else 0.01), (name, frame, error)
        for frame, degrees in changed(of, name).items():
            assert (degrees > 5) == (name == "arm" and frame in GAP), (name, frame, degrees)
    for frame in range(FIRST, FIRST + COUNT):
        got = sample(of, 'pose.bones["hips"].location', 3, frame)
        assert (Vector(got) - place(frame)).length < 1e-4

    errors = changed(of, "arm", "posing_error")
    assert 0 < errors[GAP[5]] < 20 and errors[GAP[0] - 1] == 0
    assert near(rig.pose.bones["arm"].color.custom.normal, PURPLE)
    assert near(rig.pose.bones["spine"].color.custom.normal, GREEN)
    assert near(of['pose.bones["arm"]["posing_changed"]', 0].color, PURPLE)
    keys = of['pose.bones["arm"].rotation_euler', 0].keyframe_points
    assert {int(key.co[0]) for key in keys if key.type == "EXTREME"} == set(GAP)
    assert f"arm: rotation_euler in {GAP[0]} to {GAP[-1]} filled" in bpy.context.scene["posing"]
    bpy.context.scene.frame_set(GAP[10])
    assert rig.pose.bones["arm"]["posing_changed"] == pytest.approx(changed(of, "arm")[GAP[10]])


def test_noise_is_smoothed(addon, preferences):
    rig = armature(noisy=MODES)
    noisy = turns(curves(addon, rig), "spine")
    bpy.ops.posing.clean()
    of = curves(addon, rig)
    result = turns(of, "spine")

    def error(of):
        squares = [addon.degrees_between(truth("spine", frame), turn) ** 2 for frame, turn in of.items()]
        return math.sqrt(sum(squares) / COUNT)

    assert error(result) < error(noisy) / 2
    degrees = changed(of, "spine")
    for frame, turn in result.items():
        assert abs(addon.degrees_between(noisy[frame], turn) - degrees[frame]) < 0.01
    assert near(rig.pose.bones["spine"].color.custom.normal, YELLOW)


def test_settings_reach_the_program(addon, preferences):
    rig = armature(noisy=MODES)
    preferences.no_smooth, preferences.max_gap = True, 0.3
    mark(rig, "arm")
    old = turns(curves(addon, rig), "arm")
    bpy.ops.posing.clean()
    assert all(addon.degrees_between(old[f], turn) < 0.01 for f, turn in turns(curves(addon, rig), "arm").items())
    assert "arm: 21 frames stay missing" in bpy.context.scene["posing"]


def test_audit_tells_and_changes_nothing(addon, preferences):
    rig = armature()
    before = content(addon, rig, rig.animation_data.action)
    mark(rig, "spine")
    assert bpy.ops.posing.audit() == {"FINISHED"}
    lines = bpy.context.scene["posing"]
    assert "nothing found" in lines or "timeline" in lines, lines
    assert content(addon, rig, rig.animation_data.action) == before
    bpy.ops.posing.mark_missing(first=1, last=0, forget=True)
    assert rig.animation_data.action["posing_missing"] == "[]"


def test_two_roots_and_scale_stay(addon, preferences):
    rig = armature()
    bpy.ops.object.mode_set(mode="EDIT")
    prop = rig.data.edit_bones.new("prop")
    prop.head, prop.tail = (2, 0, 0), (2, 0, 1)
    bpy.ops.object.mode_set(mode="POSE")
    mark(rig, "arm")
    bpy.ops.posing.clean()
    of = curves(addon, rig)
    worst = max(addon.degrees_between(truth("arm", f), turn) for f, turn in turns(of, "arm").items())
    assert worst < 5
    assert not any("prop" in path for path, _ in of)


def test_a_bone_that_spins_and_a_lost_root_are_filled(addon, preferences):
    rig = armature()
    for index, curve in curves(addon, rig).items():
        if index == ('pose.bones["spine"].rotation_euler', 2):
            for key in curve.keyframe_points:
                key.co[1] = key.co[0] / 15
            curve.update()
    old = turns(curves(addon, rig), "spine")
    mark(rig, "spine", "hips")
    bpy.ops.posing.clean()
    of = curves(addon, rig)
    for frame, turn in turns(of, "spine").items():
        error = addon.degrees_between(old[frame], turn)
        assert error < (5 if frame in GAP else 0.01), (frame, error)
        at = sample(of, 'pose.bones["hips"].location', 3, frame)
        assert (Vector(at) - place(frame)).length < (0.02 if frame in GAP else 1e-4)
    around = of['pose.bones["spine"].rotation_euler', 2]
    values = [around.evaluate(frame) for frame in range(FIRST, FIRST + COUNT)]
    assert max(abs(b - a) for a, b in zip(values, values[1:])) < 0.3


def test_undo_brings_the_old_action_back(addon, preferences):
    rig = armature()
    mark(rig, "arm")
    old = rig.animation_data.action.name
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.posing.clean("EXEC_DEFAULT", True)
    assert bpy.context.object.animation_data.action.name == f"{old} cleaned"
    bpy.ops.ed.undo()
    assert bpy.context.object.animation_data.action.name == old
    assert [action.name for action in bpy.data.actions] == [old]


def test_a_missing_program_is_one_clear_error(addon, preferences, monkeypatch):
    rig = armature()
    old = rig.animation_data.action
    preferences.program = "/nowhere/posing"
    with pytest.raises(RuntimeError, match="Error: /nowhere/posing: No such file or directory\n?$"):
        bpy.ops.posing.clean()
    preferences.program = ""
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RuntimeError, match="no program posing on PATH; set its path in Preferences"):
        bpy.ops.posing.clean()
    assert rig.animation_data.action == old and len(bpy.data.actions) == 1


def test_what_the_program_refuses_is_its_line(addon, preferences, tmp_path):
    armature()
    program = tmp_path / "posing"
    program.write_text("#!/bin/sh\necho a note >&2\necho clean: take.bvh: refused >&2\nexit 1\n")
    program.chmod(0o755)
    preferences.program = str(program)
    with pytest.raises(RuntimeError, match="^Error: clean: take.bvh: refused\n?$"):
        bpy.ops.posing.clean()
