"""What a vehicle cannot do, and which key of its scenario asks for it."""

from shefex_nav.errors import UserError
from shefex_nav.world.flight.timeline import Kind

_DEVICES = {Kind.YO_YO: "yo_yo", Kind.SPIN_MOTORS: "spin_motors", Kind.PARACHUTE: "parachute"}


class FlightError(UserError):
    """The vehicle cannot do what its programme asks; the message says what happened."""

    def __init__(self, words, field=()):
        """field : path in the scenario of what asks for it; (): no single key"""
        self.field = field
        super().__init__(words)


def field(params, moment):
    """Path in the scenario of the time of a timeline.Moment, () of None. params : FlightParams"""
    if moment is None:
        return ()
    match moment.kind:
        case Kind.BEGIN | Kind.END:
            name, _ = params.programme[moment.number]
            return "programme", name, "from" if moment.kind == Kind.BEGIN else "until"
        case Kind.IGNITION:
            return "vehicle", "stages", params.stages[moment.number - 1].name, "ignition"
        case Kind.SEPARATION:
            return "vehicle", "stages", params.stages[moment.number - 1].name, "separation", "at"
    return "vehicle", _DEVICES[moment.kind], "at"
