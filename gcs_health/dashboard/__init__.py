"""The screen an operator keeps open: snapshot + state + size → lines, drawn by a thin Textual app.

interface   the pipeline in a thread of its own; a mailbox that drops snapshots, never data
model       events and readings → frozen snapshots (`snapshot`), ten a second
view        pure functions: snapshot, state and size → lines of (text, style)
state       pure too: state and key → state and commands
app         Textual: keys in, changed lines out
"""
