"""Times OpenCV's four calls on depth frames: opencv.py (WIDTH FILE)...

Each file holds little-endian 16-bit counts of a millimetre, row-major. Prints OpenCV's version; then, for
each line of its input, which holds the number of a frame and how often, the milliseconds that the four calls
took each time, on one line: processor time of the one thread."""

import sys
import time

import cv2
import numpy as np

NEAR_MM, FAR_MM = 300, 900

cv2.setNumThreads(1)
kernel = np.ones((3, 3), np.uint8)


def four_calls(depth):
    mask = cv2.inRange(depth, NEAR_MM, FAR_MM)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
    cv2.connectedComponents(mask)
    cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)


def timed(depth):
    start = time.thread_time()
    four_calls(depth)
    return (time.thread_time() - start) * 1e3


frames = [
    np.fromfile(path, dtype="<u2").reshape(-1, int(width))
    for width, path in zip(sys.argv[1::2], sys.argv[2::2])
]
print(cv2.__version__, flush=True)
for line in sys.stdin:
    frame, times = map(int, line.split())
    print(*(timed(frames[frame]) for _ in range(times)), flush=True)
