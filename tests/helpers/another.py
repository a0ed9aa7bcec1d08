"""A module of discsim's that reaches into numba, loaded once more."""

import importlib.util


def loaded(module, name="another"):
    """The same source as another module."""
    spec = importlib.util.spec_from_file_location(name, module.__file__)
    other = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(other)
    return other


def loaded_without(monkeypatch, module, where, name):
    """The same after it would have taken over from a numba whose `where` has no attribute of that name."""
    assert loaded(module).known_inside
    with monkeypatch.context() as gone:
        gone.delattr(where, name)
        other = loaded(module)
        other.take_over()
        assert name not in vars(where)
    return other
