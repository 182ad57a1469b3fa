"""Geometric voting (Kolomenkin et al. 2008, IEEE Trans. AES 44(2); in Sensors 2014, 14, section 2.2).

Every pair of detections is looked up in the catalogue; each pair of stars that has its angle votes, and as an
angle does not say which end is which, both stars get a vote at both detections. The star with most votes is
the detection's identity for the time being. In a second vote all pairs of identities whose own angle is the
measured one vote for each other; right ones support each other, wrong ones stand alone. The cluster of those
that support each other is the answer.

The papers call the clustering simple and do not describe it. Here: from each identity a group grows, others
join in the order of their votes when they agree with all that are in, and the largest group is the cluster.
Three are the least that an attitude can be checked with.
`match` believes the cluster; `identify` has it verified.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing, verify
from shefex_nav.papers.angles import believed, fits, is_published, look_up, new_sides, table
from shefex_nav.records import Reason

LEAST_CLUSTER = 3  # [E] the papers do not say how large a cluster must be

NONE = int(Reason.NONE)


def match(settings, camera, pairs, u_c, flux, least_cluster=LEAST_CLUSTER):
    """The papers' own algorithm with its own acceptance; nothing is verified.

    Parameters
    ----------
    settings : Identification; of it `tolerance` (the papers' 3 epsilon) and `most_centroids`
    camera : CameraModel, not used
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera, brightest detection first
    flux : (n,)
    least_cluster : int, identities that must agree

    Returns
    -------
    Identification, its log_odds NaN: nobody has asked
    """
    n = min(len(flux), settings.most_centroids)
    if n < least_cluster:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    star = np.full(len(flux), -1, dtype=np.int64)
    n_cluster = _match_kernel(table(pairs), u_c[:n], float(settings.tolerance), star[:n])
    if n_cluster < least_cluster:
        return nothing(len(flux), Reason.NO_MATCH)
    return Identification(star, NONE, np.nan)


def identify(settings, camera, pairs, u_c, flux, P_px=None):
    """Identify the stars of one frame without any idea of the attitude: right or nothing.

    Parameters
    ----------
    settings : Identification
    camera : CameraModel
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending
    P_px : ignored; the published method knows one tolerance for all centroids

    Returns
    -------
    Identification
    """
    if min(len(flux), settings.most_centroids) < settings.fewest_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    found = match(settings, camera, pairs, u_c, flux)
    if is_published(settings):
        return believed(settings, found)
    if (found.star >= 0).sum() < settings.fewest_stars:
        return nothing(len(flux), Reason.NO_MATCH)
    found = verify(settings, camera, pairs.stars, u_c, flux, found.star)
    return found if found.reason == Reason.NONE else nothing(len(flux), found.reason)


@inner
def first_vote(table, sides):
    """Votes of the catalogue pairs: (n detections, n stars) int16."""
    n = sides.u_c.shape[0]
    votes = np.zeros((n, table.u_i.shape[0]), dtype=np.int16)
    for i in range(n):
        for j in range(i + 1, n):
            begin, end = look_up(table, sides, i, j)
            for p in range(begin, end):
                a, b = table.first[p], table.second[p]
                votes[i, a] += 1
                votes[i, b] += 1
                votes[j, a] += 1
                votes[j, b] += 1
    return votes


@inner
def validation_vote(table, sides, identity):
    """Which identities agree: (n, n) bool. identity: (n,) star of each detection, -1 without a vote."""
    n = len(identity)
    agree = np.zeros((n, n), dtype=np.bool_)
    for i in range(n):
        for j in range(i + 1, n):
            a, b = identity[i], identity[j]
            if a >= 0 and b >= 0 and a != b:
                agree[i, j] = agree[j, i] = fits(table, sides, i, j, a, b)
    return agree


@inner
def cluster(agree):
    """The largest group that grows from one detection: all its identities agree. (n, n) -> (n,) bool.

    The others join in the order of their votes. Every detection is tried as the first: one wrong identity
    that agrees with a right one by chance must not keep the rest out.
    """
    n = agree.shape[0]
    order = np.argsort(-agree.sum(axis=1), kind="mergesort")
    largest, n_largest = np.zeros(n, dtype=np.bool_), 0
    for seed in order:
        member = np.zeros(n, dtype=np.bool_)
        member[seed] = True
        n_members = 1
        for k in order:
            if agree[k, seed] and (agree[k] & member).sum() == n_members:
                member[k] = True
                n_members += 1
        if n_members > n_largest:
            largest, n_largest = member, n_members
    return largest


@kernel
def _match_kernel(table, u_c, tolerance, star):
    """Write the identities of the cluster to `star`; how many they are."""
    sides = new_sides(u_c, tolerance, 0.0)
    votes = first_vote(table, sides)
    identity = np.empty(u_c.shape[0], dtype=np.int64)
    for i in range(len(identity)):
        best = votes[i].argmax()
        identity[i] = best if votes[i, best] > 0 else -1
    member = cluster(validation_vote(table, sides, identity))
    for i in range(len(identity)):
        if member[i]:
            star[i] = identity[i]
    return member.sum()
