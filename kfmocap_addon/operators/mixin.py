"""What classes inherit from that give methods to operators, beside `bpy.types.Operator` itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

# For mypy it is an operator; Blender shall not meet operators that are never registered.
OperatorMixin = bpy.types.Operator if TYPE_CHECKING else object
