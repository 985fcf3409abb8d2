"""Blender data as core values, and back.

A *slot* is the entry of a view or a performer in the properties of a scene (`KFMocapView`, `KFMocapPerformer`).

Modules by what they are about:

- the whole shot: `scene`, `performers`, `active_performer`, `identities`
- cameras and footage: `view_cameras`, `scene_cameras`, `camera_poses`, `distortion`, `footage_background`,
  `missing_footage`, `added_views`; calibration: `capture_scene`, `solved_cameras`
- bodies: `body_armature`, `part_meshes`, `skinned_parts`, `skins`, `merged_clouds`, `performer_size`, `followed_bones`,
  `object_motion`, `prop_holds`, `hold_checks`, and how they are drawn: `shown_model`, `sides`, `key_pictures`
- poses and keys: `fcurves`, `body_channels`, `rotation_modes`, `shown_pose`, `joint_marks`, `key_pose_curves`,
  `motion_curves`; whose a key is: `key_ownership`, `tracked_keys`; `lossless` keeps what Blender rounds
- tracking and its review: `tracked_segments`, `tracking_preview`, `unfinished_tracking`, `review_data`,
  `bone_confidence`, `bone_visibility`, `lost_parts`, `unknown_bones`, `plant_lists`
"""
