"""What is found in a view's pictures alone: light that changes, dissolves, strangers; see `view_findings`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

_DEFLICKER = "filter it, as with: ffmpeg -i FOOTAGE -vf deflicker=size=15 -crf 14 CONVERTED.mp4"
_EXPOSE = (
    "film with an exposure of 1/50 or 1/100 s (1/60 or 1/120 s where the mains have 60 Hz), or in other light; this "
    "footage can be tracked, less exactly"
)


@dataclass(frozen=True)
class FindingWithoutFigures:
    """A finding without figures.

    Attributes
    ----------
    camera : str
    off
        As of other findings.
    brief : str
        A few words on it.
    """

    camera: str
    off: Literal[True] = True
    brief: ClassVar[str]
    advice: ClassVar[str]
    """What follows these words: why it matters, and what to do."""
    figures: ClassVar[dict[str, Any]] = {}

    @property
    def summary(self) -> str:
        """One line on it and what to do."""
        return f"{self.camera}: {self.brief}{self.advice}"


@dataclass(frozen=True)
class FadingPictures(FindingWithoutFigures):
    """Footage that begins with a fade."""

    by: Literal["fade"] = "fade"
    brief: ClassVar[str] = "its first pictures fade in or out"
    advice: ClassVar[str] = (
        ": the performers' colours are learned on the key frames, so begin the shot where it is as bright as later "
        "(frames under [shot]), with a key pose there"
    )


@dataclass(frozen=True)
class DissolvingPictures(FindingWithoutFigures):
    """Footage that begins with a dissolve from another scene."""

    by: Literal["dissolve"] = "dissolve"
    brief: ClassVar[str] = "its first pictures dissolve from another scene"
    advice: ClassVar[str] = (
        ": key frames there show both, so begin the shot after them (frames under [shot]), with a key pose there"
    )


@dataclass(frozen=True)
class FlickeringLight:
    """Light that flickers from frame to frame.

    Attributes
    ----------
    camera : str
    amplitude : float
        Of the brightness, relative.
    in_bands : bool
        Whether it runs through the pictures in bands.
    by, off
        As of other findings.
    """

    camera: str
    amplitude: float
    in_bands: bool = False
    by: Literal["light"] = "light"
    off: Literal[True] = True

    @property
    def brief(self) -> str:
        """A few words on how much it flickers."""
        return f"its light flickers by {self.amplitude:.0%}"

    @property
    def figures(self) -> dict[str, Any]:
        """How much it flickers, relative."""
        return {"flicker": round(self.amplitude, 3)}

    @property
    def summary(self) -> str:
        """One line on how much it flickers and what to do."""
        if self.in_bands:
            return f"{self.camera}: {self.brief} from frame to frame, in bands: {_EXPOSE}"
        return f"{self.camera}: {self.brief} from frame to frame: {_DEFLICKER}"


@dataclass(frozen=True)
class Strangers:
    """A view in which somebody or something moves beside the performers.

    Attributes
    ----------
    camera : str
    frame : int
        The key frame on which most of it is seen, as counted in the shot file.
    by, off
        As of other findings.
    """

    camera: str
    frame: int
    by: Literal["strangers"] = "strangers"
    off: Literal[True] = True

    @property
    def brief(self) -> str:
        """A few words on it."""
        return f"others move beside the performers, as on frame {self.frame}"

    @property
    def figures(self) -> dict[str, Any]:
        """On which key frame most of it is seen."""
        return {"frame": self.frame}

    @property
    def summary(self) -> str:
        """One line on it and what to do."""
        return (
            f"{self.camera}: somebody or something moves beside the performers, as on frame {self.frame}: where it is "
            "near them, they are tracked less exactly; look at these frames, set key poses there, or pose whoever it "
            "is as another performer"
        )
