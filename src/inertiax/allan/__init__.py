"""Noise of a log at rest: the Allan family of deviations, and the noise terms behind them."""

from .confidence import degrees_of_freedom as degrees_of_freedom, interval as interval
from .deviations import (
    Deviations as Deviations,
    deviations as deviations,
    KINDS as KINDS,
    usual_factors as usual_factors,
)
from .identify import identify as identify
from .logs import (
    ChannelNoise as ChannelNoise,
    LogNoise as LogNoise,
    noise_of as noise_of,
    noise_of_triads as noise_of_triads,
)
from .model import NoiseModel as NoiseModel, NoiseTerm as NoiseTerm, TERMS as TERMS
from .process_noise import (
    read_triad_noise as read_triad_noise,
    triad_noise as triad_noise,
    TriadNoise as TriadNoise,
)
from .rest_channels import logs_of as logs_of, name_of as name_of
