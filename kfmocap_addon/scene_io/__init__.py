"""Blender data as core values, and back.

A *slot* is the entry of a view or a performer in the properties of a scene (`KFMocapView`, `KFMocapPerformer`).

- the whole shot: `scene`, `performers`, `active_performer`, `identities`, `added_views`; tracking it:
  `tracked_segments`, `unfinished_tracking`
- a calibration: `capture_scene`, `solved_cameras`
- rooms of their own: `cameras`, `body`, `characters`, `keys`, `review`
- what is held and marked: `prop_holds`, `hold_checks`, `joint_marks`, `key_pictures`
- what all of them use: `fcurves`, and `lossless`, which keeps what Blender rounds
"""
