"""What pyproject.toml cannot say: a wheel has the folder setups/ as discsim/setups/, and the template of a report."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["discsim", "discsim.*"]), "discsim.setups"],
    package_dir={"discsim.setups": "setups"},
    package_data={"discsim.setups": ["*.toml"], "discsim.report": ["*.j2"]},
)
