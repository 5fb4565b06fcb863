"""Rotor health from a multirotor's MAVLink."""

__version__ = "0.1.0"
