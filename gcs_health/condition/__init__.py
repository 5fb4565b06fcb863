"""Condition for maintenance: indicators of each rotor by regime of flight, and whether they grow slowly."""
