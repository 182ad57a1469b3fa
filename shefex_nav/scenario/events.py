"""Events that the flight of a scenario may have, by their names."""

DOWN = ("apogee", "entry", "altitude_60km", "altitude_20km", "impact")


def possible(scenario):
    """Names of all events that may happen; a flight need not have all of them."""
    if scenario.ground is not None:
        return []
    if scenario.trajectory is not None:
        return _of_trajectory(scenario.trajectory)
    names = ["lift_off", "rail_exit", "max_dynamic_pressure"] if scenario.launch is not None else []
    for number, stage in enumerate(scenario.vehicle.stages.values(), 1):
        if number > 1 or stage.ignition > 0.0 or scenario.orbit is not None:
            names.append(f"ignition_{number}")
        names.append(f"burn_out_{number}")
        if stage.separation is not None:
            names.append(f"separation_{number}")
    for name, _ in scenario.tasks:
        names += [f"{name}_start", f"{name}_end"]
    vehicle = scenario.vehicle
    devices = (
        (vehicle.spin_motors, ["spin_motors"]),
        (vehicle.yo_yo, ["yo_yo_release", "yo_yo_off"]),
        (vehicle.cold_gas, ["cold_gas_empty"]),
        (vehicle.parachute, ["parachute"]),
    )
    for device, of_device in devices:
        names += of_device if device is not None else []
    return [*names, *DOWN]


def _of_trajectory(given):
    """Events that a trajectory may show, or that a log says of it."""
    n = len(given.separations)
    names = [f"{what}_{k}" for k in range(1, n + 2) for what in ("ignition", "burn_out")]
    names += [f"separation_{k}" for k in range(1, n + 1)]
    told = ["rail_exit", "parachute"] if given.format == "log" else []
    return ["lift_off", "max_dynamic_pressure", *names, *told, *DOWN]
