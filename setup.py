"""What pyproject.toml cannot say: a wheel has the folder setups/ as discsim/setups/."""

from setuptools import find_namespace_packages, setup

setup(
    packages=[*find_namespace_packages(include=["discsim*"]), "discsim.setups"],
    package_dir={"discsim.setups": "setups"},
    package_data={"discsim.setups": ["*.toml"]},
)
