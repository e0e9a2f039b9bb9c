#!/usr/bin/env python3
"""Scores frames that follow each other by FovVideoVDP, beside the flicker of their error after a blur of 4 pixels.

    pip install pyfvvdp pillow
    benches/peers/fvvdp.py REFERENCE FOLDER... [--fov-x 90] [--fps 60] [--gaze 0.5,0.5] [--skip 8]

For the sequences of `foveate measure --out DIR`, which have a history already, and a reference for each frame or one
for all:

    cd DIR/parts/KEY
    .../fvvdp.py sequence_reference_rest.frames sequence_*_rest.frames --skip 0

For frames of `foveate mock --still` REFERENCE is a converged picture of the same view, such as `foveate render
--samples full --rays 64 --passes 16` makes, and the frames after the first few count. FovVideoVDP
(Mantiuk et al. 2021) is licensed for measuring only, so it is no part of foveate and nothing depends on it.
"""

import argparse
import glob
import os

import numpy as np
from PIL import Image


def picture(path):
    return np.asarray(Image.open(path).convert("RGB"))


def blurred(frame, deviation=4.0):
    reach = int(3 * deviation)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        pad = [(0, 0)] * 3
        pad[axis] = (reach, reach)
        padded = np.pad(frame, pad, mode="edge")
        size = frame.shape[axis]
        frame = sum(k * np.take(padded, range(i, i + size), axis) for i, k in enumerate(kernel))
    return frame


def pictures(path):
    """Those of a folder, or the one."""
    if os.path.isdir(path):
        return [picture(file) for file in sorted(glob.glob(os.path.join(path, "frame_*.png")))]
    return [picture(path)]


def flicker(frames, references):
    soft = [blurred(frame.astype(float) - reference) for frame, reference in zip(frames, references)]
    return float(np.mean([np.abs(b - a).mean() for a, b in zip(soft, soft[1:])]))


def psnr(frames, references):
    error = np.mean([(frame.astype(float) - truth) ** 2 for frame, truth in zip(frames, references)])
    return float(10 * np.log10(255**2 / error))


def jod(frames, references, options):
    import pyfvvdp

    height, width = references[0].shape[:2]
    degrees = options.fov_x
    geometry = pyfvvdp.fvvdp_display_geometry([width, height], distance_m=1.0, fov_horizontal=degrees)
    photometry = pyfvvdp.fvvdp_display_photo_eotf(Y_peak=100, contrast=1000, EOTF="sRGB")
    metric = pyfvvdp.fvvdp(display_photometry=photometry, display_geometry=geometry, foveated=True, heatmap=None)
    gaze = np.array([float(v) for v in options.gaze.split(",")]) * [width, height]
    test = np.stack(frames, axis=-1)
    truth = np.stack(references, axis=-1)
    score, _ = metric.predict(
        test, truth, dim_order="HWCF", frames_per_second=options.fps, fixation_point=gaze
    )
    return float(score)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference")
    parser.add_argument("folders", nargs="+")
    parser.add_argument("--fov-x", type=float, default=90.0, help="degrees across the picture")
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--gaze", default="0.5,0.5", help="in 0..1 of the picture")
    parser.add_argument("--skip", type=int, default=8, help="frames left out at the start")
    options = parser.parse_args()
    references = pictures(options.reference)
    if not references:
        parser.error(f"{options.reference}: there is no frame_*.png in it; name a picture or a folder of frames")
    for folder in options.folders:
        frames = pictures(folder)[options.skip :]
        if len(frames) < 2:
            parser.error(f"{folder}: fewer than two frames after the first {options.skip}; render more")
        truths = references * len(frames) if len(references) == 1 else references[options.skip :]
        if len(truths) != len(frames):
            numbers = f"{len(frames)} frames, {len(truths)} references"
            parser.error(f"{folder}: {numbers}; give one reference, or one for each frame")
        scores = jod(frames, truths, options), flicker(frames, truths), psnr(frames, truths)
        print(f"{folder}: {scores[0]:.2f} JOD, low-pass flicker {scores[1]:.3f}, {scores[2]:.2f} dB")


if __name__ == "__main__":
    main()
