"""Packages that bring parts of discsim, as an installation leaves them: modules, and entry points that name parts."""

from contextlib import contextmanager

from discsim import parts
from discsim.scene import loading, tables


def install(site, modules, points):
    """Write modules (name -> text) and entry points (group -> name -> "module:object") into the folder `site`."""
    info = site / "toys-1.dist-info"
    info.mkdir(parents=True)
    for name, text in modules.items():
        (site / f"{name}.py").write_text(text)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1\n")
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in names.items()) for group, names in points.items()]
    (info / "entry_points.txt").write_text("\n".join(lines))


@contextmanager
def looked_up_anew():
    """What this process remembers of the parts that there are is forgotten, before and after."""

    def forget():
        parts.package_entry_points.cache_clear()
        for registry in vars(parts).values():
            if isinstance(registry, parts.Registry):
                registry.__dict__.pop("locations", None)
        tables._type_of.cache_clear()
        loading._table_validator.cache_clear()

    forget()
    yield
    forget()
