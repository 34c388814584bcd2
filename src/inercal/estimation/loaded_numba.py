"""Numba with all its declarations loaded; the copies of a process that imports this share them."""
# Numba has no types.
# pyright: reportUnknownMemberType=false, reportAttributeAccessIssue=false

from numba.core.registry import cpu_target

cpu_target.target_context.refresh()
