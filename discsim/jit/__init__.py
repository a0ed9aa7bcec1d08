"""Compilation: decorators of kernels, the cache of compiled code, and single precision."""
