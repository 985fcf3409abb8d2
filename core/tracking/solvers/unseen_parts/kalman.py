"""FilterPy's Kalman filter, loaded without the rest of FilterPy.

The package imports all of its filters and with them scipy.stats, which takes a quarter of a second in every process
that tracks. The Kalman filter itself uses scipy.stats only for the likelihood of its measurements. Importing this
module loads it, so import it where the filter is used; an ImportError says that FilterPy is not installed.
"""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import PathFinder
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter as Filter

_PACKAGE = "filterpy"


def _loaded_alone() -> type[Filter]:
    """Return the class `filterpy.kalman.KalmanFilter` without loading the whole package."""
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
        found: type[Filter] = importlib.import_module(f"{_PACKAGE}.kalman.kalman_filter").KalmanFilter
        return found
    finally:  # whoever imports FilterPy later has all of it
        for name in set(sys.modules) - before:
            if name.split(".")[0] == _PACKAGE:
                del sys.modules[name]


def _loaded() -> type[Filter]:
    from filterpy.kalman import KalmanFilter

    return KalmanFilter


def _log_density(*arguments: Any, **options: Any) -> float:
    """`filterpy.stats.logpdf`, loaded when it is called."""
    from filterpy.stats import logpdf

    return float(logpdf(*arguments, **options))


KalmanFilter = _loaded_alone()
