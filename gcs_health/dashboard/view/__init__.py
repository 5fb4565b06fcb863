"""Snapshot, state and size → lines of (text, style): pure functions, no Textual, no clock."""
