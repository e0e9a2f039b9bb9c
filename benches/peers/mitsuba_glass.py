#!/usr/bin/env python3
"""Glass against Mitsuba 3's `dielectric`: a sphere and a slab before a map, tile by tile.

    pip install mitsuba numpy
    benches/peers/mitsuba_glass.py FOVEATE [--size 96] [--passes 64] [--spp 4096] [--ior 1.5]

FOVEATE is the built program. Both render the same triangles (a sphere of 32,768 with smooth normals, a box) under a map
that is written here, seen along the same rays, with a sample at each pixel. The map alone is compared first. Of each shape
it tells the mean's difference over what covers it, and how many tiles of 8 by 8 pixels differ by more than
four standard deviations of the noise, which two pictures of other seeds tell of each. Mitsuba is a measuring tool:
nothing depends on it.
"""

import argparse
import json
import struct
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

EYE, FOV_Y = [0.0, 0.6, 5.0], 35.0
TILE = 8


def sphere(rows=128, columns=128):
    v, u = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij")
    points = np.stack([np.sin(v) * np.cos(u), np.cos(v), -np.sin(v) * np.sin(u)], -1).reshape(-1, 3)
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = a + columns + 1
    triangles = np.concatenate([np.stack([a, below, below + 1], 1), np.stack([a, below + 1, a + 1], 1)])
    corners = points[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return points, points, triangles[area > 1e-9]


def slab(half=(1.2, 0.9, 0.2), turn=0.5):
    points, normals, triangles = [], [], []
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    for axis in range(3):
        for side in (-1.0, 1.0):
            n, right = np.eye(3)[axis] * side, np.eye(3)[(axis + 1) % 3]
            up, first = np.cross(n, right), len(points)
            for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                points.append(rotation @ ((n + x * right + y * up) * half))
                normals.append(rotation @ n)
            triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return np.array(points), np.array(normals), np.array(triangles)


def environment(path, width=256):
    """A smooth map with all colours, that tells left from right and up from down."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(width // 2) + 0.5) / (width // 2))
    red = 1 + 0.8 * np.sin(2 * np.pi * 3 * u)
    green = 1 + 0.8 * np.cos(2 * np.pi * 2 * u) * np.sin(np.pi * v)
    blue = 0.4 + 1.2 * v
    texels = np.stack([red, green, blue], -1).astype(np.float32)
    mi.Bitmap(texels).write(str(path))


def write_glb(path, mesh, ior):
    """The mesh as solid glass; or, without one, a triangle behind the eye."""
    points, normals, triangles = mesh or (np.eye(3) * 0.01 + [0, 0, 50], np.tile([0.0, 0, 1], (3, 1)), np.array([[0, 1, 2]]))
    arrays = [points.astype("<f4"), normals.astype("<f4"), triangles.astype("<u4").ravel()]
    data, views, accessors = b"", [], []
    for i, array in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes()
        accessor = {"bufferView": i, "componentType": 5125 if i == 2 else 5126, "count": len(array)}
        accessor["type"] = "SCALAR" if i == 2 else "VEC3"
        if i == 0:
            accessor |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        accessors.append(accessor)
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_ior": {"ior": ior},
        "KHR_materials_volume": {"thicknessFactor": 1.0},
    }
    material = {
        "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.0},
        "doubleSided": True,
        "extensions": extensions,
    }
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}
    text = {
        "asset": {"version": "2.0"},
        "extensionsUsed": list(extensions),
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
        "materials": [material],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    chunk = json.dumps(text).encode()
    chunk += b" " * (-len(chunk) % 4)
    header = struct.pack("<III", 0x46546C67, 2, 28 + len(chunk) + len(data))
    head = header + struct.pack("<II", len(chunk), 0x4E4F534A) + chunk
    path.write_bytes(head + struct.pack("<II", len(data), 0x004E4942) + data)


def by_foveate(options, folder, seed):
    out = folder / "picture.exr"
    command = f"""render {folder}/scene.glb --out {out} --environment {folder}/map.exr --exposure 0
        --width {options.size} --height {options.size} --fov-y {FOV_Y} --seed {seed} --passes {options.passes}
        --position={",".join(map(str, EYE))} --look-at 0,0,0 --samples full --reconstruct k-nn
        --set reconstruction.k=1 --bounces 0"""
    subprocess.run([options.foveate, *command.split()], check=True, stdout=subprocess.DEVNULL)
    return np.array(mi.Bitmap(str(out)))[..., :3].astype(float)


def by_mitsuba(options, folder, mesh, seed):
    sensor = {
        "type": "perspective",
        "fov_axis": "y",
        "fov": FOV_Y,
        "to_world": mi.ScalarTransform4f().look_at(origin=EYE, target=[0, 0, 0], up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": options.size, "height": options.size, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": options.spp},
    }
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 18, "rr_depth": 1000},
        "sensor": sensor,
        # Its middle lies along -Z, where Mitsuba's lies along +Z.
        "map": {
            "type": "envmap",
            "filename": str(folder / "map.exr"),
            "to_world": mi.ScalarTransform4f().rotate([0, 1, 0], 180),
        },
    }
    if mesh:
        points, normals, triangles = mesh
        shape = mi.Mesh("shape", len(points), len(triangles), has_vertex_normals=True)
        values = mi.traverse(shape)
        values["vertex_positions"] = points.astype(np.float32).ravel()
        values["vertex_normals"] = normals.astype(np.float32).ravel()
        values["faces"] = triangles.astype(np.uint32).ravel()
        values.update()
        shape.write_ply(str(folder / "shape.ply"))
        glass = {"type": "dielectric", "int_ior": options.ior, "ext_ior": 1.0}
        scene["shape"] = {"type": "ply", "filename": str(folder / "shape.ply"), "bsdf": glass}
    return np.array(mi.render(mi.load_dict(scene), seed=seed)).astype(float)[..., :3]


def tiles(picture):
    n = picture.shape[0] // TILE
    return picture[: n * TILE, : n * TILE].reshape(n, TILE, n, TILE, 3).mean((1, 3))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("foveate")
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--passes", type=int, default=64)
    parser.add_argument("--spp", type=int, default=4096)
    parser.add_argument("--ior", type=float, default=1.5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, background = Path(name), None
        environment(folder / "map.exr")
        for shape, mesh in (("map", None), ("sphere", sphere()), ("slab", slab())):
            write_glb(folder / "scene.glb", mesh, options.ior)
            ours = [by_foveate(options, folder, seed) for seed in (1, 2)]
            theirs = [by_mitsuba(options, folder, mesh, seed) for seed in (1, 2)]
            background = theirs[0] if background is None else background
            us, them = np.mean(ours, 0), np.mean(theirs, 0)
            covered = np.ones(us.shape[:2], bool) if mesh is None else np.abs(them - background).max(-1) > 0.02
            noise = (np.abs(tiles(ours[0] - ours[1])) + np.abs(tiles(theirs[0] - theirs[1]))) / 2
            # Differences of two pictures are a coarse estimate of each tile's noise: that of all tiles bounds it from below.
            noise = np.maximum(noise, np.sqrt((noise**2).mean())) + 1e-4
            apart = np.abs(tiles(us) - tiles(them))
            bias = (us[covered].mean(0) - them[covered].mean(0)) / them[covered].mean(0)
            print(
                f"{shape}: {covered.mean():.0%} of the picture, mean off by {us[covered].mean() / them[covered].mean() - 1:+.3%}"
                f" (red, green, blue {', '.join(f'{b:+.3%}' for b in bias)});"
                f" tiles off by {np.sqrt((apart**2).mean()):.4f} rms, {apart.max():.4f} at most, of noise of"
                f" {np.sqrt((noise**2).mean()):.4f}; beyond four deviations {(apart > 4 * noise).mean():.1%}"
            )


if __name__ == "__main__":
    main()
