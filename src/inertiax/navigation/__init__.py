"""Navigation with the calibration inside: a navigator, and a filter that estimates the calibration on the way."""

from .filter import Filter as Filter, Track as Track
from .filter_state import Estimate as Estimate, FilterState as FilterState
from .level_frame import LevelFrame as LevelFrame
from .observability import Observability as Observability, observability as observability
from .process import ImuNoise as ImuNoise, TriadNoise as TriadNoise
from .refine import coefficient_covariance as coefficient_covariance, refined as refined
from .se23 import ExtendedPose as ExtendedPose
from .smoother import smooth as smooth, Smoothed as Smoothed
from .strapdown import ImuData as ImuData
from .updates import (
    Attitude as Attitude,
    on_segments as on_segments,
    Position as Position,
    Residual as Residual,
    Velocity as Velocity,
    zero_velocity as zero_velocity,
)
