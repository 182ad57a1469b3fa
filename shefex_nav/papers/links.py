"""Differences that another experiment explains: known once both have run."""

from shefex_nav.papers import rows

# the second has no part in the best case, in which there are no false objects
JOINT = "2 things otherwise, the joint set of assumptions: the spot, and magnitudes of the false objects"
# name -> (the experiment that has something otherwise, what); rows belong together by quantity and condition
EXPLAINED_BY = {
    "impa-images": ("impa-joint", JOINT),
    "impa-attitude": ("impa-joint", JOINT),
}


def linked(outcomes):
    """Outcomes whose rows are explained where another of them reaches the published figure.

    outcomes : dict of name -> Outcome
    """
    made = dict(outcomes)
    for name, (other, words) in EXPLAINED_BY.items():
        if name in outcomes and other in outcomes:
            there = {(row.quantity, row.condition): row for row in outcomes[other].rows}
            found = []
            for row in outcomes[name].rows:
                variant = there.get((row.quantity, row.condition))
                found.append(row if variant is None else rows.explained(row, variant, other, words))
            made[name] = outcomes[name]._replace(rows=found)
    return made
