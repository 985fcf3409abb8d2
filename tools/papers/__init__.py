"""The terms of the papers, as docs/papers.md lists them, each with a way to break it."""

from .motion_terms import MOTION_TERMS
from .system_terms import SYSTEM_TERMS

TERMS = (*MOTION_TERMS, *SYSTEM_TERMS)
