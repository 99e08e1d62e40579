"""Recordings of a robot's joint (position, speed, torque): friction, ripple and elasticity by torque residuals."""
