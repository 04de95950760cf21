"""Recordings, read back."""

import numpy as np


def column(path, entity, component, timeline="increment"):
    """Values of a component by its place on a timeline; the one without a time has None."""
    from rerun.chunk import RrdReader

    by_step = {}
    for chunk in RrdReader(path).stream():
        if chunk.entity_path != entity:
            continue
        batch = chunk.to_record_batch()
        if not chunk.is_static and timeline not in batch.schema.names:
            continue
        names = [name for name in batch.schema.names if name.endswith(f":{component}")]
        for name in names:
            values = batch.column(name).to_pylist()
            steps = [None] * len(values) if chunk.is_static else batch.column(timeline).to_pylist()
            by_step.update({step: _array(v) for step, v in zip(steps, values, strict=True) if v is not None})
    return by_step


def _array(values):
    """Values as an array; of lines with different numbers of points, an array of each."""
    lengths = {len(value) for value in values if isinstance(value, list)}
    return np.array(values) if len(lengths) < 2 else [np.array(value) for value in values]
