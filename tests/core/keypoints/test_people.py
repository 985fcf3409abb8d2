"""People are found in the detections of several views, told apart, counted, and given to performers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.errors import KeypointError
from kfmocap.core.keypoints.association.assignment import Identity, PerformerClues, assign_detections
from kfmocap.core.keypoints.association.tracks import ViewDetections, detection_tracks
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.left_and_right.left_right import swap_sides

Array = np.ndarray
FPS, FRAMES = 30.0, 30
NOISE = 0.02
"""Of a detector, metres across a ray at one metre for each metre of distance."""
MAN, WOMAN, BYSTANDER = 0, 1, 2
PLACES = ((-0.45, 0.1, 0), (0.45, -0.1, 0), (-3.5, 3.0, 0))


class Scene:
    """What detectors find of people: each view lists them in no order, misses some, and takes some for turned round."""

    def __init__(self, people: Sequence[int], views: int = 3, places: Sequence[Sequence[float]] = PLACES) -> None:
        rng = np.random.default_rng(0)
        self.people = people
        self.points = [seen_places(human(), strolling(human(), FRAMES, places[p], p)) for p in people]
        each = [keypoints_of(cameras(views), points, NOISE, seed) for seed, points in enumerate(self.points)]
        turned = [swap_sides(keypoints) for keypoints in each]
        self.founds, self.whose = [], []
        for v in range(views):
            rows = [
                (f, p)
                for f in range(FRAMES)
                for p in rng.permutation(len(people))
                if not (v == p % views and 8 <= f < 14)  # somebody is missed for a while
            ]
            rays = [(turned if f // 5 == v + 1 else each)[p].rays[v, f] for f, p in rows]
            nobody = np.full(len(rows), -1)
            frames = np.array([f for f, _ in rows])
            self.founds.append(ViewDetections(frames, np.stack(rays), np.ones((len(rows), len(NAMES))), nobody))
            self.whose.append(np.array([people[p] for _, p in rows]))
        one = each[0]
        self.empty = Keypoints(
            NAMES, np.full_like(one.rays, np.nan), np.zeros_like(one.confidence), one.R_cam_world, one.t_cam_world
        )

    def assigned(self, *wanted: PerformerClues) -> tuple[list[Keypoints], list[Identity]]:
        return assign_detections(self.founds, self.empty, wanted, FPS)

    def shares(self, keypoints: Keypoints) -> Array:
        """Of each person's detections, the share that keypoints hold."""
        shares = np.zeros(3)
        for person in self.people:
            own = [
                np.array_equal(keypoints.rays[v, frame], rays, equal_nan=True)
                for v, found in enumerate(self.founds)
                for frame, rays, whose in zip(found.frames, found.rays, self.whose[v], strict=True)
                if whose == person
            ]
            shares[person] = np.mean(own)
        return shares


@pytest.mark.parametrize("views", [3, 2])
def test_people_in_one_list_are_distinguished_without_key_poses(views: int) -> None:
    """The cameras are equally high: rays of two people meet as well as those of one, but not at a body's size."""
    scene = Scene((MAN, WOMAN), views)
    found, identities = scene.assigned(PerformerClues("a"), PerformerClues("b"))
    shares = np.array([scene.shares(keypoints) for keypoints in found])[:, :2]
    assert sorted(shares.argmax(axis=1)) == [0, 1]
    assert (shares.max(axis=1) > 0.95).all() and (shares.min(axis=1) == 0).all()
    assert [(i.person, i.people, i.reason) for i in identities] == [
        (1, 2, "order of appearance"),
        (2, 2, "order of appearance"),
    ]


def test_who_is_whose_number_is_chosen_first() -> None:
    scene = Scene((MAN, WOMAN))
    first = scene.assigned(PerformerClues("a"), PerformerClues("b"))[0][0]
    exchanged, identities = scene.assigned(PerformerClues("a", person=2), PerformerClues("b"))
    assert scene.shares(first).argmax() == scene.shares(exchanged[1]).argmax()
    assert [(i.person, i.reason) for i in identities] == [(2, "number"), (1, "order of appearance")]


@pytest.mark.parametrize(
    ("numbers", "message"), [((3, None), "no person 3: 2 were found"), ((1, 1), "person 1 is another")]
)
def test_a_number_that_nobody_has_or_two_claim_is_refused(numbers: tuple[int | None, ...], message: str) -> None:
    with pytest.raises(KeypointError, match=message):
        Scene((MAN, WOMAN)).assigned(*(PerformerClues(name, person=n) for name, n in zip("ab", numbers, strict=True)))


def test_key_poses_say_who_a_performer_is() -> None:
    scene = Scene((MAN, WOMAN))
    for order in ((0, 1), (1, 0)):
        places = []
        for person in order:
            known = np.full_like(scene.points[person], np.nan)
            known[4] = scene.points[person][4]
            places.append(known)
        found, identities = scene.assigned(*(PerformerClues(n, known) for n, known in zip("ab", places, strict=True)))
        assert [scene.shares(keypoints).argmax() for keypoints in found] == list(order)
        assert {identity.reason for identity in identities} == {"key poses"}


def test_a_bystander_at_the_back_is_counted_and_is_nobody() -> None:
    scene = Scene((MAN, WOMAN, BYSTANDER))
    found, identities = scene.assigned(PerformerClues("a"), PerformerClues("b"))
    shares = np.array([scene.shares(keypoints) for keypoints in found])
    assert (shares[:, BYSTANDER] == 0).all() and (shares[:, :2].max(axis=1) > 0.95).all()
    assert {identity.people for identity in identities} == {3}


def test_where_two_meet_in_a_view_their_tracks_end() -> None:
    """They walk through each other in one view: who goes on where cannot be told from it."""
    body = human()
    path = np.linspace(-0.02, 0.02, FRAMES)
    points = seen_places(body, strolling(body, 1))
    both = [points + np.stack([sign * path, 0 * path, 0 * path], axis=1)[:, None] for sign in (1, -1)]
    rays = np.stack([keypoints_of(cameras(1), p, 0.002, i).rays[0] for i, p in enumerate(both)], axis=1)
    frames, person = np.nonzero(np.ones((FRAMES, 2), bool))
    found = ViewDetections(frames, rays[frames, person], np.ones((len(frames), len(NAMES))), np.full(len(frames), -1))
    tracks = detection_tracks(NAMES, found, 0, FPS)
    assert len(tracks) >= 4
    assert all(len(set(person[track.rows])) == 1 for track in tracks)
