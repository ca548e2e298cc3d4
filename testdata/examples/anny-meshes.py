#!/usr/bin/env python3
"""Samples meshes of the body model Anny (Apache-2.0; its data CC0): poses.npz of one body, people.npz, meters, z up.

    pip install anny
    python3 anny-meshes.py
    posing body-train --units m --up z --poses poses.npz --shapes people.npz -o anny.npz

A model learned from these meshes may be used and passed on as Anny's licenses say. The same would not hold for SMPL and its kin, whose
licenses allow research alone: look at the license of what you sample before you ship what you learn.
"""
import math
import sys

import anny
import numpy as np
import torch

POSES, PEOPLE = 40, 40
# Bones that turn, and by how much, degrees.
LIMBS = {
    "upperarm01": 50, "lowerarm01": 50, "upperleg01": 45, "lowerleg01": 45, "wrist": 20, "foot": 15, "shoulder01": 10,
}
TRUNK = {"spine03": 15, "spine01": 10, "neck01": 15}


def main():
    rng = np.random.default_rng(0)
    model = anny.create_fullbody_model(triangulate_faces=True, pose_parameterization="local-ref").to(torch.float32)
    bones = list(model.bone_labels)
    limits = {f"{name}.{side}": by for name, by in LIMBS.items() for side in "LR"} | TRUNK
    missing = [name for name in limits if name not in bones]
    if missing:
        sys.exit(f"this version of Anny has no bones {missing}")

    def turned(scale):
        pose = np.tile(np.eye(4, dtype=np.float32), (1, len(bones), 1, 1))
        for name, by in limits.items():
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            angle = math.radians(by) * scale * rng.uniform(-1, 1)
            x = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
            rotation = np.eye(3) + math.sin(angle) * x + (1 - math.cos(angle)) * x @ x
            pose[0, bones.index(name), :3, :3] = rotation
        return torch.from_numpy(pose)

    def mesh(pose, person):
        with torch.no_grad():
            out = model(pose_parameters=pose, phenotype_kwargs=person)
        return out["vertices"][0].numpy().astype(np.float32)

    adult = dict.fromkeys(model.phenotype_labels, 0.5) | {"age": 0.67}
    draw = lambda: {name: float(rng.uniform(0.1, 0.9)) for name in adult} | {"age": float(rng.uniform(0.6, 0.9))}
    faces = np.asarray(model.faces, dtype=np.int32)
    poses = [mesh(turned(0 if k == 0 else 1), adult) for k in range(POSES)]
    people = [mesh(turned(0.1), draw()) for _ in range(PEOPLE)]
    np.savez("poses.npz", vertices=np.stack(poses), faces=faces)
    np.savez("people.npz", vertices=np.stack(people), faces=faces)
    print(f"poses.npz, people.npz: {len(poses)} and {len(people)} meshes of {poses[0].shape[0]} vertices")


main()
