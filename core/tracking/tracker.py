"""Tracking a shot: at the scale of a person, and again where the result shows damaged frames or gaps in the footage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..body.motion import Motion
from ..body.unknown_parts import without_hidden_solids
from ..runtime.progress import Progress
from ..runtime.threads import one_library_thread
from ..runtime.timing import Seconds
from ..shot.grips import completed
from ..shot.shot import Shot
from .footage_corrections.damaged_footage import decoder_messages, found_damage, known_damage, without_damaged
from .footage_corrections.footage_gaps import (
    MAX_GAPS,
    fits_better,
    unaffected,
    with_found_gaps,
    with_gaps,
    without_false_delays,
)
from .results.journal import FinishedSegment
from .results.track_result import TrackResult
from .scheduling.run_context import PLAIN_RUN, RunContext
from .scheduling.schedule import Observer
from .scheduling.segment_tracking import TrackOptions, track_segments
from .scheduling.shot_checks import check_shot
from .shot_scale import ShotScale
from .track_state import Around


@one_library_thread()
def track(
    shot: Shot,
    progress: Progress | None = None,
    observe: Observer | None = None,
    pictures: Sequence[int] = (),
    around: Around = (None, None),
    *,
    run: RunContext = PLAIN_RUN,
    earlier: Sequence[Motion] = (),
) -> TrackResult:
    """Track every performer of a shot.

    Parameters
    ----------
    shot : Shot
    progress : callable, optional
        See `core.runtime.progress.Progress`; returning False cancels.
    observe : callable, optional
        Called with a segment, the number of its iteration, and the motions of its frames before that iteration.
    pictures : sequence of int, optional
        Frames, counted from the shot's first, whose pictures are kept in the result.
    around : tuple of (tuple of Motion or None), optional
        If the shot is an excerpt of a longer one: every performer's pose on the frame before its first and on the one
        after its last, where known. These poses are held, and the motion continues smoothly from and to them.
    run : RunContext, optional
        Journal, cache and callbacks; none of them changes the result.
    earlier : sequence of Motion, optional
        Every performer's motion as it was tracked before some key poses changed, from which segments are solved. A
        segment whose solution is doubtful then is solved again without it. Not used if the footage offset is still to
        be measured.

    Raises
    ------
    ShotError
        The shot has one frame only, or a performer has no key pose and is in no pose or motion that is known.
    FootageError
        Footage is missing, unreadable, too short or of another size than the calibration's.
    CancelledError
    """
    check_shot(shot, motion_known=bool(earlier) or any(around))
    given, scale = shot.performers, ShotScale.of(shot)
    shot, views_as_given = _in_order(scale.shot(shot))
    options = TrackOptions(
        progress=progress,
        observe=scale.observer(observe),
        pictures=pictures,
        around=scale.around(around),
        run=scale.run(run),
        earlier=scale.motions(earlier),
        views_as_given=views_as_given,
    )
    result = _tracked_with_corrections(shot, options)
    return scale.result(result.of_views(views_as_given), given)


def _tracked_with_corrections(shot: Shot, options: TrackOptions) -> TrackResult:
    """Track a shot, then again what changes with the damaged frames and the gaps in its footage that this has shown."""
    memory = options.run.memory
    known = known_damage(shot, memory)
    shot = without_damaged(shot, known)
    with decoder_messages(memory) as log:
        result, done = track_segments(shot, options)
    damage = found_damage(shot, result, log, known, memory)
    sound = with_found_gaps(without_damaged(shot, damage), result.gaps)
    if [view.damaged for view in sound.views] != [view.damaged for view in shot.views]:
        result, done = _tracked_again(sound, shot, options, result, done)
        shot = sound
    result = without_false_delays(shot, result)
    for _ in range(MAX_GAPS):
        corrected = with_gaps(shot, result)
        if corrected is None:
            break
        again, done_again = _tracked_again(corrected, shot, options, result, done)
        if not fits_better(again, result):
            result = replace(result, seconds=again.seconds)
            break
        shot, result, done = corrected, again, done_again
    return replace(result, damage=damage)


def _tracked_again(
    corrected: Shot, before: Shot, options: TrackOptions, result: TrackResult, done: Sequence[FinishedSegment]
) -> tuple[TrackResult, list[FinishedSegment]]:
    """Track again what changes with corrected gaps or damaged frames; the time counts in all."""
    kept = unaffected(done, with_found_gaps(before, result.gaps), corrected)
    run = replace(options.run, solved=None, first_pictures=None)
    again, done_again = track_segments(corrected, replace(options, run=run), kept)
    seconds = Seconds(result.seconds)
    seconds.add(again.seconds)
    return replace(again, seconds=seconds), done_again


def _in_order(shot: Shot) -> tuple[Shot, list[int]]:
    """Return the shot with its views sorted by name, and the index there of each of the given views.

    The order of the views must not affect the result, and it would: the rounding of a sum depends on its order.
    """
    order = sorted(range(len(shot.views)), key=lambda v: shot.views[v].camera.name)
    performers = tuple(replace(p, body=without_hidden_solids(p.body, p.unknown)) for p in shot.performers)
    in_order = replace(shot, views=tuple(shot.views[v] for v in order), performers=performers)
    return completed(in_order), [order.index(v) for v in range(len(order))]
