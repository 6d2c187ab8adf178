"""Names of joints and markers without what programs put before them, and without case.

``mixamorig:LeftArm``, ``Subject 1:LeftArm``, ``Armature|LeftArm`` and, where most names begin alike, ``Actor_LeftArm`` are all
``LeftArm``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

_SHARE = 0.8
"""A prefix that ends in ``_``, ``.`` or a space is one of the program if at least this share of the names begin with it."""
_FEW = 4
"""Fewer names than this have no common prefix."""


def without_prefixes(names: Sequence[str]) -> tuple[str, ...]:
    """Remove namespaces, and a prefix that most names share.

    >>> without_prefixes(["mixamorig:Hips", "Armature|Hips", "Hips"])
    ('Hips', 'Hips', 'Hips')
    >>> without_prefixes(["Bip01", "Bip01_Head", "Bip01_Neck", "Bip01_Spine", "Bip01_L_Foot", "Bip01_R_Foot"])
    ('Bip01', 'Head', 'Neck', 'Spine', 'L_Foot', 'R_Foot')
    """
    bare = [without_namespace(name) for name in names]
    starts = Counter(start[0] for name in bare if (start := re.match(r"[^_. ]+[_. ]+(?=.)", name)))
    prefix, count = starts.most_common(1)[0] if starts else ("", 0)
    if len(bare) >= _FEW and count >= _SHARE * len(bare):
        bare = [name.removeprefix(prefix) for name in bare]
    return tuple(bare)


def without_namespace(name: str) -> str:
    """Part of a name after its last ``:`` or ``|``."""
    return re.split("[:|]", name)[-1].strip() or name


def folded(name: str) -> str:
    """A name in small letters, without punctuation; ``+`` stays.

    >>> folded("L.ASIS + R.ASIS")
    'lasis+rasis'
    """
    return re.sub("[^0-9a-z+]", "", name.lower())
