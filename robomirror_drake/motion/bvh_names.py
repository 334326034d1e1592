"""From the joint names of a BVH dialect to the 22 joints of HumanML3D.

Covers CMU, Mixamo and MotionBuilder, Bandai-Namco, LaFAN, 3ds Max Biped, Daz/Poser,
SMPL exports, Rigify, Unreal and the first BioVision files. Only the limbs, neck, head
and pelvis go by name; the spine is whatever lies between pelvis and neck.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

CENTRAL: dict[str, tuple[str, ...]] = {
    "pelvis": ("hips", "pelvis", "hip", "root"),
    "neck": ("neck", "neck1", "neck01", "necklower", "spineshoulder"),
    "head": ("head",),
}
"""Synonyms of the joints on the body's axis, in lower case, best first."""

SIDED: dict[str, tuple[str, ...]] = {
    "knee": ("knee", "lowerleg", "lowleg", "shin", "calf", "shank", "leg"),
    "hip": ("upleg", "upperleg", "thigh", "hip", "leg"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "toe0", "ball", "forefoot", "foot"),
    "wrist": ("wrist", "hand"),
    "elbow": ("elbow", "forearm", "lowerarm", "lowarm"),
    "shoulder": ("arm", "upperarm", "uparm", "shldr", "shoulder"),
    "collar": ("collar", "clavicle", "collarbone", "shoulder"),
}
"""Synonyms of the limbs' joints. A name goes to the first that claims it: ``Shoulder``
is the collar where there is an ``Arm``, else the shoulder; likewise ``Foot``, ``Leg``."""

_PREFIX = re.compile(
    r"^(mixamorig\d*|bip\d+|joint|jnt|j_bip_c|m_avg|def|skel|character\d*)[ _.:-]*", re.IGNORECASE
)
_SIDE = (
    re.compile(r"^(?P<side>left|right)[ _.-]*(?P<part>.+)$", re.IGNORECASE),
    re.compile(r"^(?P<part>.+?)[ _.-]*(?P<side>Left|Right)$"),
    re.compile(r"^(?:.*[ _.-])?(?P<side>[lr])[ _.-](?P<part>.+)$", re.IGNORECASE),
    re.compile(r"^(?P<part>.+)[ _.-](?P<side>l|r|left|right)$", re.IGNORECASE),
    re.compile(r"^(?P<side>[lrLR])(?P<part>[A-Z].+)$"),
    re.compile(r"^(?P<side>[lr])(?P<part>" + "|".join(
        sorted({s for names in SIDED.values() for s in names}, key=len, reverse=True)) + ")$"),
)  # fmt: skip


def split_name(name: str) -> tuple[str, str]:
    """Side (``left``, ``right`` or empty) and bare lower-case part of a joint's name."""
    bare = _PREFIX.sub("", name.split(":")[-1].strip())
    for pattern in _SIDE:
        if match := pattern.match(bare):
            side = "left" if match["side"].lower().startswith("l") else "right"
            return side, _letters(match["part"])
    return "", _letters(bare)


def match_joints(names: Sequence[str]) -> dict[str, int]:
    """Index into ``names`` of every HumanML3D joint that one of them stands for."""
    by_part: dict[tuple[str, str], int] = {}
    for i, name in enumerate(names):
        by_part.setdefault(split_name(name), i)
    found: dict[str, int] = {}
    for joint, synonyms in CENTRAL.items():
        for synonym in synonyms:
            if ("", synonym) in by_part:
                found[joint] = by_part["", synonym]
                break
    for side in ("left", "right"):
        for joint, synonyms in SIDED.items():
            for synonym in synonyms:
                if (i := by_part.get((side, synonym), -1)) >= 0 and i not in found.values():
                    found[f"{side}_{joint}"] = i
                    break
    return found


def _letters(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())
