"""The core's inner loops as pure functions of their draws.

They run the code that the navigators run, on the scalar float64 path, so that an independent implementation can be
checked against them to rounding. Every random draw is an argument. Positions are (N, 2) arrays [east, north] in
metres; log-likelihoods carry no 2π terms.
"""

from uwcoop._native import (
    bilinear_depth,
    bilinear_gradient,
    decode_belief,
    decode_graph,
    effective_sample_size,
    encode_belief,
    encode_graph,
    filtered_error_delta,
    fit_mixture,
    kernel_entropy,
    liu_west,
    moments,
    normalize,
    offset_update,
    origin_delta,
    pattern_depths,
    pose_graph,
    propagate,
    range_log_likelihood,
    reconstruct_graph,
    residual_resample,
    roughen,
    schur_marginalize,
    terrain_log_likelihood,
)

__all__ = [
    "bilinear_depth",
    "bilinear_gradient",
    "decode_belief",
    "decode_graph",
    "effective_sample_size",
    "encode_belief",
    "encode_graph",
    "filtered_error_delta",
    "fit_mixture",
    "kernel_entropy",
    "liu_west",
    "moments",
    "normalize",
    "offset_update",
    "origin_delta",
    "pattern_depths",
    "pose_graph",
    "propagate",
    "range_log_likelihood",
    "reconstruct_graph",
    "residual_resample",
    "roughen",
    "schur_marginalize",
    "terrain_log_likelihood",
]
