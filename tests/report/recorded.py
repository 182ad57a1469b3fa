"""The made-up mission while the star tracker works, as a log, and what is in a recording of it."""

import sys
from pathlib import Path

import pytest
import synthetic_run
from rerun.chunk import RrdReader

from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.writer import LogWriter

OPTIONS = synthetic_run.Options(start_s=231.0, end_s=241.0)
NO_VULKAN = pytest.mark.skipif(
    sys.platform == "linux" and not any(Path("/usr/share/vulkan/icd.d").glob("*.json")),
    reason="no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1 libgl1-mesa-dri",
)


def write(path):
    """The log; returns its path."""
    with LogWriter(path, synthetic_run.mission(), FramePolicy(10, "thresholded", 4.0)) as log:
        for record in (*synthetic_run.simulate(OPTIONS), synthetic_run.summary(OPTIONS)):
            log.write(record)
    return path


def chunks(recording):
    return [chunk for chunk in RrdReader(recording).stream() if not chunk.is_static]


def chunks_of(reader):
    return [chunk for chunk in reader.stream() if not chunk.is_static]


def values_of(saved, entity, component):
    """(mission times s, first values) of a component of an entity."""
    times, values = [], []
    for chunk in chunks(saved):
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if component in name]
        if str(chunk.entity_path) == entity and names:
            times += (batch.column("mission_time").cast("int64").to_numpy() / 1e9).tolist()
            values += [value[0] for value in batch.column(names[0]).to_pylist()]
    return times, values
