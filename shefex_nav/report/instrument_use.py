"""How many readings of the instruments beside IMU, GPS and stars reached the filter's gate, and were used."""

from shefex_nav.onboard.navigation.quantity import about


def instrument_use(gates):
    """Sequence of GateResult -> {name of an instrument: {"readings": at the gate, "used": of these}}"""
    found = {}
    for gate in gates:
        if gate.dof and about(gate.sensor) is None:
            counts = found.setdefault(gate.sensor, {"readings": 0, "used": 0})
            counts["readings"] += 1
            counts["used"] += bool(gate.accepted)
    return dict(sorted(found.items()))
