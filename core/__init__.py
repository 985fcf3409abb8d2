"""Keyframe tracking without Blender: footage to evidence to solver to motion.

"Paper 1" is Y. Ohta, T. Yamagiwa, M. Yamamoto, Keyframe Tracking of Human Body in 3D Motion from a Monocular Image
Sequence (1998), "paper 2" S. Shishido, M. Saito, T. Ando, 3D Motion Capturing Using Body Model; see docs/papers.md.
"""
