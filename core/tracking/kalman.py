"""FilterPy's Kalman filter, loaded without the rest of FilterPy.

The package imports all of its filters and with them scipy.stats, which takes a quarter of a second in every process
that tracks. The Kalman filter itself uses scipy.stats only for the likelihood of its measurements.
"""

from __future__ import annotations

import importlib
import sys
from functools import cache
from importlib.machinery import PathFinder
from threading import Lock
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

_PACKAGE = "filterpy"
_lock = Lock()


@cache
def kalman_filter_class() -> type[KalmanFilter]:
    """Return the class `filterpy.kalman.KalmanFilter` without loading the whole package.

    Raises
    ------
    ImportError
        FilterPy is not installed.
    """
    with _lock:
        if _PACKAGE in sys.modules:
            return _loaded()
        spec = PathFinder.find_spec(_PACKAGE)
        if spec is None or not spec.submodule_search_locations:
            return _loaded()  # Python's own way: it raises, or knows better
        before = set(sys.modules)
        [folder] = spec.submodule_search_locations
        try:
            for name, place in ((_PACKAGE, folder), (f"{_PACKAGE}.kalman", f"{folder}/kalman")):
                package = ModuleType(name)
                package.__path__ = [place]
                sys.modules[name] = package
            statistics: Any = ModuleType(f"{_PACKAGE}.stats")
            statistics.logpdf = _log_density
            sys.modules[statistics.__name__] = statistics
            found: type[KalmanFilter] = importlib.import_module(f"{_PACKAGE}.kalman.kalman_filter").KalmanFilter
            return found
        finally:  # whoever imports FilterPy later has all of it
            for name in set(sys.modules) - before:
                if name.split(".")[0] == _PACKAGE:
                    del sys.modules[name]


def _loaded() -> type[KalmanFilter]:
    from filterpy.kalman import KalmanFilter

    return KalmanFilter


def _log_density(*arguments: Any, **options: Any) -> float:
    """`filterpy.stats.logpdf`, loaded when it is called."""
    from filterpy.stats import logpdf

    return float(logpdf(*arguments, **options))
