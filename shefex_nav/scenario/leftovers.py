"""Stages that a scenario has from the file that it extends, where they do not go with its own."""

STAGES = ("vehicle", "stages")
COUNTED = ("imu", "vibration", "boost")  # one value for each stage


def noted(found, names, places, others):
    """The same contradictions; the first about stages says which are inherited, and how to leave them out.

    Parameters
    ----------
    found : list of (path of the field, text)
    names : of the stages
    places : messages.Places of the scenario
    others : {path of another file: 'extends', 'uses', what the scenario does with it}
    """
    inherited = {}  # file: names
    for name in names:
        file = places.key((*STAGES, name)).file
        if others.get(file) == "extends":
            inherited.setdefault(file, []).append(name)
    mine = len(names) - sum(map(len, inherited.values()))
    about = [k for k, (path, _) in enumerate(found) if _is_about(path)]
    if not (inherited and mine and about):
        return found
    first = min(about, key=lambda k: places.value(found[k][0]))
    path, words = found[first]
    for file, left in inherited.items():
        nulls = ", ".join(f"{name}: null" for name in left)
        verb = "comes" if len(left) == 1 else "come"
        words += f"; {' and '.join(left)} {verb} from {file}: '{nulls}' under vehicle.stages leaves out"
        words += " what your rocket has not"
    return [*found[:first], (path, words), *found[first + 1 :]]


def _is_about(path):
    return path[:2] == STAGES or path[:3] == COUNTED
