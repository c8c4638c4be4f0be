"""The lidar's distances inside observations, found by the names of the features."""

import re
from collections.abc import Sequence

import numpy as np

from swarmdata.specs.features import Feature
from swarmdata.types import Float

_BEAM_DISTANCE = re.compile(r"beam_(\d+)\.distance")  # not of older frames: they end with an age


def scan_of(features: Sequence[Feature], observations: Float) -> Float | None:
    """Returns the distances of beams in observations [..., N, O], as shares of the lidar's range.

    They are [..., N, K], the first beam along the heading, then counter-clockwise; None without.
    """
    columns = [k for k, feature in enumerate(features) if _BEAM_DISTANCE.fullmatch(feature.name)]
    return observations[..., np.array(columns)] if columns else None
