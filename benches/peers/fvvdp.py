#!/usr/bin/env python3
"""Scores frames of `foveate mock --still` by FovVideoVDP, beside their flicker after a blur of 4 pixels.

    pip install pyfvvdp pillow
    benches/peers/fvvdp.py REFERENCE.png FOLDER... [--fov-x 90] [--fps 60] [--gaze 0.5,0.5] [--skip 8]

REFERENCE is a converged picture of the same view, such as `foveate render --samples full --rays 64 --passes 16`
makes. Of each folder the frames after the first few count: a headset's pictures have a history, too. FovVideoVDP
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


def flicker(frames):
    soft = [blurred(frame.astype(float)) for frame in frames]
    return float(np.mean([np.abs(b - a).mean() for a, b in zip(soft, soft[1:])]))


def psnr(frames, reference):
    error = np.mean([(frame.astype(float) - reference) ** 2 for frame in frames])
    return float(10 * np.log10(255**2 / error))


def jod(frames, reference, options):
    import pyfvvdp

    height, width = reference.shape[:2]
    degrees = options.fov_x
    geometry = pyfvvdp.fvvdp_display_geometry([width, height], distance_m=1.0, fov_horizontal=degrees)
    photometry = pyfvvdp.fvvdp_display_photo_eotf(Y_peak=100, contrast=1000, EOTF="sRGB")
    metric = pyfvvdp.fvvdp(display_photometry=photometry, display_geometry=geometry, foveated=True, heatmap=None)
    gaze = np.array([float(v) for v in options.gaze.split(",")]) * [width, height]
    test = np.stack(frames, axis=-1)
    still = np.stack([reference] * len(frames), axis=-1)
    score, _ = metric.predict(
        test, still, dim_order="HWCF", frames_per_second=options.fps, fixation_point=gaze
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
    reference = picture(options.reference)
    for folder in options.folders:
        frames = [picture(path) for path in sorted(glob.glob(os.path.join(folder, "frame_*.png")))]
        frames = frames[options.skip :]
        if len(frames) < 2:
            parser.error(f"{folder}: fewer than two frames after the first {options.skip}; render more")
        scores = jod(frames, reference, options), flicker(frames), psnr(frames, reference.astype(float))
        print(f"{folder}: {scores[0]:.2f} JOD, low-pass flicker {scores[1]:.3f}, {scores[2]:.2f} dB")


if __name__ == "__main__":
    main()
