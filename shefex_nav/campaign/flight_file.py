"""The one flight that all runs of a campaign share, as bytes of an .npz file, which executes nothing."""

import io

import numpy as np

from shefex_nav import files
from shefex_nav.records import Event, Trajectory
from shefex_nav.world.flight.fly import ControlHistory, Flight


def to_bytes(flight):
    """Bytes of a Flight."""
    arrays = {f"trajectory.{name}": column for name, column in flight.trajectory._asdict().items()}
    for name in Event._fields:
        arrays[f"event.{name}"] = np.array([getattr(event, name) for event in flight.events])
    if flight.control is not None:
        arrays |= {f"control.{name}": column for name, column in flight.control._asdict().items()}
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def from_bytes(content):
    """Flight of such bytes; ValueError or KeyError if they are something else."""
    arrays = files.arrays_of(io.BytesIO(content))
    trajectory = Trajectory(*(arrays[f"trajectory.{name}"] for name in Trajectory._fields))
    columns = [arrays[f"event.{name}"].tolist() for name in Event._fields]
    events = tuple(Event(*row) for row in zip(*columns, strict=True))
    control = None
    if "control.t_s" in arrays:
        control = ControlHistory(*(arrays[f"control.{name}"] for name in ControlHistory._fields))
    return Flight(trajectory, events, control)
