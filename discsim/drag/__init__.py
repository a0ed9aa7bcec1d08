"""Drag schemes, one a file, with one signature: `relax(drag, state, dt, gas_vel, heat)`.

It kicks gas and dust over dt, accelerations and drag together: dust in place, the gas in `gas_vel` (n, d), for one-way
drag a copy that nobody reads afterwards. It writes `drag.stopping_times` of the dust and `drag.uncoupled`, and if
`heat` has entries the heat per mass of each gas particle. An explicit scheme also has `limit(drag, state)`, the longest
stable step.

On a fixed grid, where fluxes are the accelerations: `advance(drag, tube, cells, dt)`, which returns what the
`cells` (5, n) of a `ppm.Tube` hold dt later.
"""

# Name in the scene -> module.
SCHEMES = {
    "idic": "discsim.drag.idic",
    "idic-linear": "discsim.drag.idic_linear",
    "tsc": "discsim.drag.tsc",
    "mk": "discsim.drag.mk",
    "lab14": "discsim.drag.lab14",
    "reconstructed": "discsim.drag.reconstructed",
    "esph": "discsim.drag.esph",
    "isph": "discsim.drag.isph",
}
GRID_SCHEMES = {"sios-ppm": "discsim.drag.sios_ppm", "emsi-ppm": "discsim.drag.emsi_ppm"}
