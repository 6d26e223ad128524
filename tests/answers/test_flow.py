"""Exact flows, gases and refractivities: their numbers, and the averages of cells that fields are made of."""

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow import billig, ciddor, gas, models, shocks, species, taylor_maccoll
from aerokernels.flow.fan_field import expansion_fan, mach_after_turn, maximum_expansion
from aerokernels.flow.refractivity import gladstone_dale_constant
from aerokernels.flow.riemann import GasState, riemann

from .records import Nudge

STAGES = ("flow/",)
FLOWS = {
    "wedge": lambda mach, turn: flow.wedge(mach, turn, spacing=0.005),
    "strong": lambda mach, turn: flow.plane_shock(mach, turn, strong=True, spacing=0.005, length=0.06, height=0.04),
    "normal": lambda mach, turn: flow.plane_shock(mach, spacing=0.005),
    "expansion": lambda mach, turn: flow.expansion(mach, turn, spacing=0.005),
    "cone": lambda mach, turn: flow.cone(mach, turn, length=0.02),
    "sphere": lambda mach, turn: flow.blunt_body(mach, 0.01, spacing=0.001),
    "cylinder": lambda mach, turn: flow.blunt_body(mach, 0.01, spacing=0.001, geometry="planar"),
    "vortex": lambda mach, turn: flow.vortex(0.3 * mach, spacing=0.002),
    "tube": lambda mach, turn: flow.shock_tube(
        GasState(1.2 * mach, 2e5), GasState(0.4, 3e4, 20.0), 4e-5, length=0.1, spacing=0.002, axis="z"
    ),
    "tube across": lambda mach, turn: flow.shock_tube(
        GasState(0.3, 2e4), GasState(1.2 * mach, 2e5, -10.0), 4e-5, length=0.1, spacing=0.002, width=0.02
    ),
}


@pytest.mark.parametrize("name", FLOWS)
@pytest.mark.parametrize("mach", [1.9, 3.4])
def test_field(answers, name: str, mach: float):
    """Densities at points and as averages, scaled, and as a refractive index."""

    def case(nudge: Nudge):
        found = FLOWS[name](nudge(mach), nudge(0.2))
        rng = np.random.default_rng(3)
        points = rng.uniform(-0.02, 0.06, (40, 3))
        index = found.scaled(0.8).index_field(600e-9)
        body = None if found.body is None else found.body.walls
        return found.density_at(points), index, index.contrast_at(points), body, index.box

    answers(case)


def test_shocks(answers):
    """Turns, angles and jumps over Mach numbers and ratios of heats."""

    def case(nudge: Nudge):
        found = []
        for mach, gamma in ((1.6, 1.4), (2.5, 1.4), (6.0, 1.3), (2.0, 5.0 / 3.0)):
            mach = nudge(mach)
            found += [
                shocks.normal_shock(mach, gamma=gamma),
                shocks.maximum_deflection(mach, gamma=gamma),
                shocks.prandtl_meyer(mach, gamma=gamma),
                gas.isentropic(mach, gamma=gamma),
                shocks.oblique_shock(mach, 0.03, gamma=gamma),
                shocks.oblique_shock(mach, 0.05, strong=True, gamma=gamma),
                expansion_fan(mach, 0.15, gamma=gamma),
                maximum_expansion(mach, gamma=gamma),
                mach_after_turn(0.4, gamma=gamma),
                gas.free_stream(mach, 0.7, 240.0, gamma=gamma),
                gas.tunnel_conditions(mach, 4e5, 310.0, gamma=gamma),
                billig.bow_shock(mach, 0.02),
                billig.bow_shock(mach, 0.02, geometry="planar"),
            ]
        bow = billig.bow_shock(2.3, 0.02)
        r = np.linspace(0.0, 0.08, 9)
        along = bow.z_at(r), bow.radius_at(bow.z_at(r)), bow.normal_mach_square_at(r), bow.distance_along(r)
        return found, along, gas.stagnation_ratio(0.5, 4e4, 1.4), gas.free_stream(2.0).at_density(0.3)

    answers(case)


def test_cones(answers):
    """Shocks about cones, and the flow between cone and shock."""

    def case(nudge: Nudge):
        found = [taylor_maccoll.maximum_cone_angle(nudge(mach)) for mach in (2.2,)]
        for mach, angle in ((1.5, 0.1), (6.0, 0.6), (3.0, 0.02)):
            shock = taylor_maccoll.cone_shock(nudge(mach), angle)
            ray = np.linspace(angle, 1.3 * shock.shock_angle, 11)
            found += [shock, shock.density_ratio_at(ray), shock.velocity_at(ray)]
        return found

    answers(case)


def test_riemann(answers):
    """Two gases side by side: shocks, rarefactions, vacuum nearly."""

    def case(nudge: Nudge):
        found = []
        for left, right in (
            (GasState(1.2, 1e5), GasState(0.3, 1e4)),
            (GasState(0.3, 1e4), GasState(1.2, 1e5)),
            (GasState(1.0, 1e5, -300.0), GasState(1.0, 1e5, 300.0)),
            (GasState(1.0, 1e5, 300.0), GasState(1.1, 9e4, -200.0)),
        ):
            one = riemann(GasState(nudge(left.density), left.pressure, left.velocity), right)
            speed = np.linspace(-900.0, 900.0, 25)
            found += [one, one.density_at(speed), one.velocity_at(speed), one.pressure_at(speed), one.breaks]
            found += [left.sound_speed(1.4), left.temperature(287.0)]
        return found

    answers(case)


def test_refractivity(answers):
    """Constants of gases and mixtures over the wavelength, and moist air."""

    def case(nudge: Nudge):
        found = []
        for wavelength in (500e-9, 633e-9, 1550e-9):
            wavelength = nudge(wavelength)
            found += [
                ciddor.ciddor_constant(wavelength, water=0.01),
                gladstone_dale_constant(wavelength),
                ciddor.ciddor_refractivity(wavelength, 300.0, 9e4, humidity=0.4),
            ]
            found += [
                species.species_constant(name, wavelength, form)
                for name in ("N2", "O2", "Ar", "CO2", "He")
                for form in ("gladstone-dale", "lorentz-lorenz")
            ]
            mixed = {"N2": 0.7, "O2": 0.2, "CO2": 0.1}
            for relation, options in (
                ("gladstone-dale", {}),
                ("lorentz-lorenz", {}),
                ("ciddor", {}),
                ("gladstone-dale", {"constant": 2.3e-4}),
                ("gladstone-dale", {"composition": mixed}),
            ):
                model = models.refractivity_model(relation, **options)
                density = np.linspace(0.1, 2.0, 5)
                found += [
                    model.constant(wavelength),
                    model.refractivity(density, wavelength),
                    model.contrast(density, 1.0, wavelength),
                    model.ambient_index(1.1, wavelength),
                    model,
                ]
        found += [ciddor.moist_air_density(290.0, 9.5e4, water=0.01), ciddor.water_fraction(295.0, 1e5, 0.5)]
        return found, [species.molar_mass(name) for name in ("N2", "H2O")]

    answers(case)
