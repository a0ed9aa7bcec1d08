"""Opacity of the dust and gas of a disc by Bell & Lin (1994, ApJ 427, 987, appendix): kappa = k rho^a T^b in cgs.

    ice grains            2e-4 T^2                    evaporation of metals   2e81 rho T^-24
    evaporation of ice    2e16 T^-7                   molecules               1e-8 rho^(2/3) T^3
    metal grains          0.1 T^(1/2)                 H scattering            1e-36 rho^(1/3) T^10
                                                      bound-free, free-free   1.5e20 rho T^(-5/2)
                                                      electron scattering     0.348

Each regime begins at the temperature at which its opacity equals that of the regime before. If kappa has a peak
where two regimes cross, kappa is the smaller of their opacities; if kappa has a valley, it is the larger. kappa is
thus continuous for any rho.
"""

BELL_LIN = (
    (2e-4, 0.0, 2.0),
    (2e16, 0.0, -7.0),
    (0.1, 0.0, 0.5),
    (2e81, 1.0, -24.0),
    (1e-8, 2.0 / 3.0, 3.0),
    (1e-36, 1.0 / 3.0, 10.0),
    (1.5e20, 1.0, -2.5),
    (0.348, 0.0, 0.0),
)  # (k, a, b) in the order of rising temperature
METALS = 2e17 ** (1.0 / 7.5)  # temperature (K) from which on metal grains dominate: 2e16 T^-7 = 0.1 T^(1/2)
# Lower bound of rho in kappa, in g/cm3: at this density metal grains still evaporate after ice, and gas is transparent.
THINNEST = 1e-24
