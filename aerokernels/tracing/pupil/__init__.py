"""Pupils of up to millions of rays: choose the quadrature, trace the rays on the device, and sum them there."""
