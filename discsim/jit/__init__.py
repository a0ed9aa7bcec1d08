"""Compiling: decorators of kernels, where compiled code is kept, and single precision."""
