"""Statements of docs/validation/published.md about Sminchisescu and Triggs 2001, from the tables of that page."""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_papers.sminchisescu_triggs.claims import claims
from poseppl_papers.tables import Table

Tables = Mapping[str, Table]


def verdicts(tables: Tables) -> str:
    """Each claim with ours and its verdict."""
    return "\n".join(f"- {claim.what}: {claim.verdict} ({claim.ours}; theirs: {claim.theirs})" for claim in claims(tables))
