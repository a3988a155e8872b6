"""Fetch the public logs that are not among `INERTIAX_RECORDINGS`: `python fetch.py -o FOLDER` (needs git).

- staticposes: ChanghyeonKim93/IMU_calibration_staticposes, three logs of an Xsens MTi over ROS, hand-held;
- gesture, position: shenshikexmu/IMUCalibration-Gesture and ImuCalibration-Poistion, an InvenSense sensor by hand.

The repositories name no licence for their data; nothing of them is kept here.
"""

import argparse
import subprocess
from pathlib import Path


REPOSITORIES = {
    "staticposes": "ChanghyeonKim93/IMU_calibration_staticposes",
    "gesture": "shenshikexmu/IMUCalibration-Gesture",
    "position": "shenshikexmu/ImuCalibration-Poistion",
}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--base", default="https://github.com", help="or a folder of mirrors")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    for name, repository in REPOSITORIES.items():
        target = args.output / name
        if not target.exists():
            subprocess.run(
                ["git", "clone", "--quiet", "--depth", "1", f"{args.base}/{repository}", target],
                check=True,
            )


if __name__ == "__main__":
    main()
