"""A multirotor whose truth is known: physics, faults, sensors, and MAVLink as autopilots speak it."""
