"""Damaged footage: its pictures get no weight.

That a file is damaged is known once its frames were decoded, by what the decoder says, or by pictures that do not
continue. The segments with the damaged pictures are then tracked again without these.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import zip_longest

from ...errors import FootageError
from ...runtime.decoder_log import DecoderLog
from ...runtime.processes.worker_memory import WorkerMemory
from ...shot.fingerprint import made_of
from ...shot.footage import working_factor
from ...shot.footage_faults.footage_damage import FootageDamage, shot_damage
from ...shot.frame_numbers import file_index
from ...shot.shot import Shot, View
from ..results.track_result import TrackResult
from .footage_gaps import with_found_gaps

Damage = tuple[FootageDamage | None, ...]
"""Per view."""
_EARLIER = "what decoders said earlier"


def known_damage(shot: Shot, memory: WorkerMemory | None) -> Damage:
    """Return what is known of the damage of a shot's footage: its frames in memory are not decoded again."""
    if memory is None:
        return ()
    try:
        return tuple(memory.value(_key(shot, view), lambda: None) for view in shot.views)
    except (OSError, FootageError):  # whoever reads the footage reports it
        return ()


@contextmanager
def decoder_messages(memory: WorkerMemory | None) -> Iterator[DecoderLog]:
    """Collect the decoders' messages. If the run ends early, the next one with this memory gets them, too, as it may
    not decode the same frames again.
    """
    with DecoderLog() as log:
        if memory is not None:
            log.complaints += memory.value(_EARLIER, lambda: None) or []
        try:
            yield log
        finally:
            log.new()
            if memory is not None:
                memory.replace_value(_EARLIER, log.complaints)


def found_damage(
    shot: Shot, result: TrackResult, log: DecoderLog, known: Damage, memory: WorkerMemory | None
) -> Damage:
    """Return the damage of a shot's footage once it is tracked; empty if there is none.

    Parameters
    ----------
    shot : Shot
    result : TrackResult
        Its gaps, and which of its frames do not continue.
    log : DecoderLog
        What decoders said meanwhile.
    known : tuple of FootageDamage or None
        See `known_damage`.
    memory : WorkerMemory, optional
    """
    found = shot_damage(with_found_gaps(shot, result.gaps), result.torn, reported=bool(log.complaints))
    found = tuple(then if own is None else own.joined(then) for own, then in zip_longest(found, known))
    found = tuple(own and replace(own, weighed=len(shot.views) == 1) for own in found)
    if memory is not None:
        memory.replace_value(_EARLIER, [])
        for view, own in zip(shot.views, found, strict=True):
            memory.replace_value(_key(shot, view), own)
    return found if any(found) else ()


def without_damaged(shot: Shot, damage: Damage) -> Shot:
    """Return a shot whose damaged frames are known, and have no weight; in a shot of one view all have."""
    if not any(damage):
        return shot
    views = []
    for view, own in zip(shot.views, damage, strict=True):
        first, last = (file_index(view, frame) for frame in shot.frames)
        stretches = () if own is None or own.weighed else own.stretches
        views.append(replace(view, damaged=tuple(s for s in stretches if s[0] <= last and first <= s[1])))
    return replace(shot, views=tuple(views))


def _key(shot: Shot, view: View) -> tuple[str, bytes]:
    return "damage", made_of(view, working_factor(view, shot.settings.working_size))
