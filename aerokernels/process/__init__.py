"""Manage the process and its machine: cores, memory, threads, children, interrupts, clocks, and kernel caches."""
