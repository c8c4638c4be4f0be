"""Policies of one simulator in another one."""
