"""Foreground by background subtraction, an adaptive mixture of Gaussians a pixel, and completed by colour with graph cuts.

The mixture is that of Zivkovic (2004, doi:10.1109/ICPR.2004.1333992), OpenCV's MOG2, a successor of the one of Stauffer and
Grimson that Peursum et al. (2008, section 5) and Darby et al. (2008, section 6.1) subtract. A background is learned from an
empty clip, from the clip itself, or from a single picture of the empty scene (a plate): a plate is a clip of one frame.

    background = learn_background(video.images(), settings)
    foreground, ignore = background.subtract(image)

All frames of a clip count alike: they are learned in a mixed order, then the mixture is frozen. So a frame's foreground
depends on the frame alone, and a person who stands still at the end does not fade away. A clip that contains the person
teaches a pixel's background only where the person is absent for more than about half of the time.

Background subtraction loses an arm, or cuts a person in two, where clothes or skin have the colour of the scene behind them.
GrabCut (Rother, Kolmogorov and Blake 2004, doi:10.1145/1015706.1015720), OpenCV's, decides by the colours that are known to be
the person's, by those of the scene near by, and by edges between neighbours. Only pixels that differ from the background at
all, if by less than makes foreground, may join the person; the inside of the mask stays.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.checks import check_at_least, check_fraction
from poseppl.errors import InputError
from poseppl.motion.io.opencv import Image, check_image, opencv
from poseppl.motion.vision.masks import Mask, clean_mask, keep_together, window

MAX_LEARNING_BYTES = 2**30
_USUAL = 640 * 480
"""Pixels of a picture that the settings' diameters and areas are meant for."""


class BackgroundSettings(NamedTuple):
    """How foreground is found and cleaned.

    Diameters and areas are those in a picture of at most 640 x 480 px; in larger ones they grow with it.

    Attributes:
        threshold: Distance in standard deviations, over the three channels together, from which a pixel is foreground.
        noise: Standard deviation of a pixel's noise, gray levels: what a component starts from and does not fall below.
        components: Gaussians a pixel.
        background_share: Share of the frames that background must explain; components are taken from the heaviest down. A
            small share takes the heaviest alone.
        shadow: Brightness, relative to the background, down to which a darker pixel of the same colour is a shadow; 1 turns
            shadows off.
        shadows: Treatment of a shadow.
        opening: Diameter in px of the disc that removes specks; 0 for none.
        closing: Diameter in px of the disc that closes gaps; 0 for none.
        min_area: Regions of fewer px are removed.
        largest_hole: Holes of at most this many px are filled.
        reach: Regions that are further from the largest one than this share of the square root of its area are not the
            person (:func:`~poseppl.motion.vision.keep_together`); 0 keeps all.
        refine: Whether the mask is completed by colour (:mod:`poseppl.motion.vision.background`); some 40 ms a picture.
        learning_rate: Weight of each further frame in the frozen mixture; above 0 the foreground depends on the order.
        learned_frames: At most so many frames, evenly spread, are learned from.
    """

    threshold: float = 4.0
    noise: float = 6.0
    components: int = 5
    background_share: float = 0.3
    shadow: float = 0.6
    shadows: Literal["background", "foreground", "ignore"] = "background"
    opening: int = 3
    closing: int = 7
    min_area: int = 400
    largest_hole: int = 100
    reach: float = 0.5
    refine: bool = False
    learning_rate: float = 0.0
    learned_frames: int = 200

    def check(self) -> BackgroundSettings:
        """Refuse settings that cannot be used.

        Returns:
            The settings.

        Raises:
            ValueError: A number is out of its range, or ``shadows`` is unknown.
        """
        check_at_least(0, opening=self.opening, closing=self.closing, min_area=self.min_area)
        check_at_least(0, largest_hole=self.largest_hole)
        check_at_least(1, components=self.components, learned_frames=self.learned_frames)
        check_at_least(0, reach=self.reach)
        check_at_least(0.1, threshold=self.threshold, noise=self.noise)
        check_fraction("(0, 1]", background_share=self.background_share, shadow=self.shadow)
        check_fraction("[0, 1]", learning_rate=self.learning_rate)
        if self.shadows not in ("background", "foreground", "ignore"):
            raise ValueError(f"shadows is {self.shadows!r}. Expected 'background', 'foreground' or 'ignore'.")
        return self


class Foreground(NamedTuple):
    """Pixels on the person, and pixels without evidence.

    Attributes:
        foreground: (H, W) uint8, 1 for foreground and 0 elsewhere.
        ignore: (H, W) uint8, 1 where there is no evidence; ``foreground`` is 0 there.
    """

    foreground: Mask
    ignore: Mask


class Background(NamedTuple):
    """A learned background.

    Attributes:
        mixture: OpenCV's background subtractor.
        settings: Settings of its learning.
        size: Width and height in px.
    """

    mixture: Any
    settings: BackgroundSettings
    size: tuple[int, int]

    def subtract(self, image: Image, ignore: Mask | None = None, occlusion: Mask | None = None) -> Foreground:
        """Find the foreground of a frame.

        Args:
            image: (H, W, 3) RGB or (H, W) gray.
            ignore: (H, W), not 0 at pixels that give no evidence; None for none.
            occlusion: (H, W), not 0 where furniture may stand before a person; None for nowhere.

        Returns:
            The foreground, cleaned.

        Raises:
            InputError: The image or the mask has another size than the background.
        """
        rgb = _rgb(image)
        for name, array in (("image", rgb), ("ignore mask", ignore), ("occlusion mask", occlusion)):
            if array is not None and array.shape[1::-1] != self.size:
                problem = f"the {name} has {array.shape[1]} x {array.shape[0]} pixels"
                raise InputError(problem, expected=f"{self.size[0]} x {self.size[1]}, as the background")
        labels = self.mixture.apply(rgb, None, self.settings.learning_rate)
        shadow, found = labels == 127, labels == 255
        blind = np.zeros(found.shape, bool) if ignore is None else np.asarray(ignore) != 0
        if self.settings.shadows == "foreground":
            found |= shadow
        mask = _cleaned((found & ~blind).astype(np.uint8), self.settings)
        if self.settings.reach:
            mask = keep_together(
                mask, self.settings.reach, blind if occlusion is None else blind | (np.asarray(occlusion) != 0)
            )
        if self.settings.refine:
            mask = refine_mask(rgb, self.mixture.getBackgroundImage(), mask, self.settings.noise)
        mask = mask * ~blind
        if self.settings.shadows == "ignore":
            blind = blind | (shadow & (mask == 0))
        return Foreground(mask.astype(np.uint8), blind.astype(np.uint8))


def learn_background(images: Iterable[Image], settings: BackgroundSettings | None = None) -> Background:
    """Learn a background from a clip, of the empty scene or of the person moving through it.

    Args:
        images: (H, W, 3) RGB or (H, W) gray images of one size; at most ``learned_frames`` of them are held in memory.
        settings: The settings; None for the default ones.

    Returns:
        The background.

    Raises:
        InputError: There is no image, an image is malformed, sizes differ, or they would need more than 1 GiB.
        ValueError: A setting is out of its range.
    """
    chosen = (settings or BackgroundSettings()).check()
    kept = _evenly_spread(images, chosen.learned_frames)
    if not kept:
        raise InputError("no image to learn the background from", expected="at least one")
    mixture = _new_mixture(chosen)
    # Steps of the golden section visit a clip evenly: no part of it weighs more for having come last.
    order = np.argsort(np.modf(np.arange(len(kept)) * 0.6180339887498949)[0], kind="stable")
    for count, index in enumerate(order, start=1):
        mixture.apply(kept[index], None, 1.0 / count)
    return Background(mixture, chosen, kept[0].shape[1::-1])


def background_from_plate(plate: Image, settings: BackgroundSettings | None = None) -> Background:
    """Make a background of one picture of the empty scene.

    Args:
        plate: (H, W, 3) RGB or (H, W) gray.
        settings: The settings; None for the default ones.

    Returns:
        The background.
    """
    return learn_background([plate], settings)


def _cleaned(mask: Mask, settings: BackgroundSettings) -> Mask:
    """The mask, cleaned by the settings at its size."""
    larger = max(1.0, (mask.size / _USUAL) ** 0.5)
    return clean_mask(
        mask,
        opening=_odd(settings.opening * larger),
        closing=_odd(settings.closing * larger),
        min_area=round(settings.min_area * larger**2),
        largest_hole=round(settings.largest_hole * larger**2),
    )


def _odd(diameter: float) -> int:
    """The nearest odd number: a disc that has a middle."""
    return 2 * round((diameter - 1) / 2) + 1


def _rgb(image: Image) -> Image:
    checked = check_image(image)
    return checked if checked.ndim == 3 else np.repeat(checked[..., None], 3, axis=-1)


def _evenly_spread(images: Iterable[Image], most: int) -> list[Image]:
    kept: list[Image] = []
    step = 1
    for number, image in enumerate(images):
        if number % step:
            continue
        kept.append(_rgb(image))
        if kept[-1].shape != kept[0].shape:
            problem = f"image {number} has {kept[-1].shape[1]} x {kept[-1].shape[0]} pixels"
            raise InputError(problem, expected=f"{kept[0].shape[1]} x {kept[0].shape[0]}, as the first one")
        if len(kept) > most or (len(kept) > 1 and len(kept) * kept[0].nbytes > MAX_LEARNING_BYTES):
            kept, step = kept[::2], 2 * step
    return kept


def _new_mixture(settings: BackgroundSettings) -> Any:
    mixture = opencv().createBackgroundSubtractorMOG2(detectShadows=settings.shadow < 1.0)
    variance = settings.noise**2
    mixture.setVarThreshold(settings.threshold**2)
    mixture.setVarInit(variance)
    mixture.setVarMin(variance)
    mixture.setVarMax(max(5.0 * variance, 75.0))
    mixture.setNMixtures(settings.components)
    mixture.setBackgroundRatio(settings.background_share)
    mixture.setShadowThreshold(settings.shadow)
    return mixture


_MARGIN = 0.1
"""How far from the mask a pixel may join it, of the mask's height."""
_SIZE = 320
"""The cut is made at a longer side of at most so many px."""
_NEIGHBOURS = 5
"""Side in px of the square over which differences are averaged, and by which the mask is eroded to its inside."""


def refine_mask(image: Image, background: Image, mask: Mask, noise: float) -> Mask:
    """Complete a foreground mask by colour.

    Args:
        image: (H, W, 3) RGB.
        background: The scene without the person (H, W, 3).
        mask: (H, W) uint8, 0 or 1.
        noise: Pixels that differ from the background by this root mean square, gray levels, may be the person's.

    Returns:
        (H, W) uint8, 0 or 1; an empty mask stays empty.
    """
    tight = window(mask, 0)
    if tight is None:
        return mask
    margin = max(4.0, _MARGIN * (tight[0].stop - tight[0].start))
    part = window(mask, margin)
    height, width = mask[part].shape
    scale = min(1.0, _SIZE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    cv2 = opencv()
    seen, plain = (cv2.resize(each[part], size, interpolation=cv2.INTER_AREA) for each in (image, background))
    small = cv2.resize(mask[part], size, interpolation=cv2.INTER_NEAREST)
    guess = _guess(seen, plain, small, noise, margin * scale)
    if not (np.any(guess % 2 == 0) and np.any(guess % 2 == 1)):  # colours of one side alone
        return mask
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)  # its colour models start from a random clustering
    cv2.grabCut(np.ascontiguousarray(seen), guess, None, *models, 1, cv2.GC_INIT_WITH_MASK)
    cut = cv2.resize((guess % 2).astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
    refined = np.zeros_like(mask)
    refined[part] = cut
    return refined


def _guess(image: Image, background: Image, mask: Mask, noise: float, margin: float) -> NDArray[np.uint8]:
    """Initial labels of a cut: the person (inside the mask), perhaps (its rim), perhaps not (what differs near by), or not."""
    cv2 = opencv()
    difference = np.sum((image.astype(np.float32) - background) ** 2, -1)
    differs = cv2.blur(difference, (_NEIGHBOURS, _NEIGHBOURS)) > image.shape[-1] * noise**2
    away = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
    guess: NDArray[np.uint8] = np.where(differs & (away <= margin), cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    guess[mask > 0] = cv2.GC_PR_FGD
    guess[cv2.erode(mask, np.ones((_NEIGHBOURS, _NEIGHBOURS), np.uint8)) > 0] = cv2.GC_FGD
    return guess
