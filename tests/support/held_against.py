"""The truth that each method is held against, and the test that does it: tables of the reference of methods."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import places
from percuss.methods.registry import Registry

# What each method is held against, beside what all are held against, and the test below `tests/truth`.
HELD: dict[str, dict[str, tuple[str, str]]] = {
    "integrators": {
        "asynchronous": (
            "stability map of one mass between two springs (Fong, Darve and Lew 2008)",
            "test_own_steps.py::test_one_mass_between_two_springs_has_the_resonance_of_the_text",
        ),
        "central-difference": (
            "force history of Kolman et al.'s impact of two bars; exact at a Courant number of 1 with `lagrange`",
            "test_methods.py::test_the_papers_figure",
        ),
        "chung-lee": (
            "published update, limit and order",
            "test_schemes.py::test_the_limit_of_stability_is_the_published_one",
        ),
        "explicit-hht": (
            "published update and limit",
            "test_schemes.py::test_the_kernel_makes_the_published_step",
        ),
        "explicit-newmark": (
            "published limit; without damping the displacements of central difference",
            "test_schemes.py::test_undamped_members_have_the_displacements_of_central_difference",
        ),
        "hulbert-chung": (
            "where the roots meet in the paper; its limit is not the one that is often quoted",
            "test_schemes.py::test_the_roots_meet_where_the_paper_says",
        ),
        "noh-bathe": (
            "dense matrices, limit and order of the paper",
            "test_methods.py::test_multi_stage_runs_equal_full_matrices",
        ),
        "tchamwa-wielgosz": (
            "published update, limit and order",
            "test_schemes.py::test_the_order_is_the_published_one",
        ),
        "velocity-verlet": (
            "central difference, to round-off",
            "test_schemes.py::test_velocity_verlet_is_central_difference",
        ),
        "viscous-central-difference": (
            "limit and damping ratio of the text (Belytschko et al., ch. 6)",
            "test_viscosity.py::test_the_limit_of_the_lagging_rate_is_the_quoted_one",
        ),
        "wu-predictor-corrector": (
            "force history and limits of Kolman et al.'s impact of two bars",
            "test_methods.py::test_the_papers_figure",
        ),
    },
    "contacts": {
        "bipenalty": (
            "forces of Kolman et al.; limits of one free node; `lagrange` for a matched mass",
            "test_methods.py::test_matched_bipenalty_tends_to_the_lagrange_method",
        ),
        "cohesive": (
            "its envelope and energy of separation in closed form; the paper could not be read",
            "test_laws.py::test_a_bond_follows_its_envelope_and_takes_the_energy_to_break_it",
        ),
        "damped-penalty": (
            "restitution of the dashpot in closed form (Schwager and Poeschel)",
            "test_laws.py::test_the_restitution_of_the_dashpot_is_that_of_schwager_and_poeschel",
        ),
        "energy-conserving-penalty": (
            "energy kept over all impacts, as the paper proves",
            "test_laws.py::test_a_force_by_difference_quotient_keeps_energy_over_all_impacts",
        ),
        "hunt-crossley": (
            "its equation of motion, integrated by SciPy",
            "test_state_variables.py::test_rigid_bodies_leave_a_hunt_crossley_spring_as_its_equation_of_motion_says",
        ),
        "lagrange": (
            "exact force at a Courant number of 1",
            "test_methods.py::test_the_lagrange_method_is_exact_at_the_magic_step",
        ),
        "moreau-jean": (
            "work of an impact law (1 - e²)/2 of the relative motion",
            "test_laws.py::test_the_work_of_an_impact_law_is_that_of_the_restitution",
        ),
        "nitsche": (
            "normal force of the end elements, in a march of its own",
            "test_methods.py::test_nitsche_reads_the_normal_force_of_the_end_elements",
        ),
        "paoli-schatzman": (
            "without restitution `lagrange`",
            "test_laws.py::test_without_restitution_the_impact_law_on_gaps_is_the_lagrange_method",
        ),
        "penalty": (
            "forces of Kolman et al.; critical Courant numbers with either leap-frog scheme",
            "test_stability.py::test_the_published_critical_courant_numbers",
        ),
        "regularised-lagrange": (
            "a matched `bipenalty` with Wu's predictor-corrector; tends to `lagrange`",
            "test_laws.py::test_the_regularised_lagrange_method_is_the_matched_bipenalty_of_wu",
        ),
        "softened-penalty": (
            "the pressure where bodies touch, as the manual defines it",
            "test_laws.py::test_a_softened_penalty_presses_with_its_pressure_where_the_bodies_touch",
        ),
        "tied": (
            "dense matrices of bars with a common node",
            "test_methods.py::test_runs_equal_the_dense_solver",
        ),
        "uzawa": (
            "its iterates are penalties at the predicted gap that tend to `lagrange`",
            "test_laws.py::test_uzawas_iteration_is_a_predictor_penalty_of_a_stiffness_that_tends_to_lagrange",
        ),
        "walton-braun": (
            "restitution of two rigid bodies",
            "test_state_variables.py::test_rigid_bodies_leave_a_walton_braun_spring_at_e_times_their_speed",
        ),
    },
    "masses": {
        "lumped": ("dense matrices", "test_methods.py::test_runs_equal_the_dense_solver"),
        "reciprocal": (
            "its dispersion relation, of fourth order at 3/8; the papers could not be read",
            "test_coupled_masses.py::test_waves_have_the_frequencies_of_the_dispersion_relation",
        ),
        "redistributed": (
            "energy kept in ten bounces, as published",
            "test_ends_without_mass.py::test_ten_bounces_keep_as_much_energy_as_published_figures_say",
        ),
        "scaled": (
            "the step that it promises, and the least mass for it",
            "test_parts_of_bodies.py::test_scaled_masses_allow_the_step_that_they_promise_and_add_no_more_than_that",
        ),
    },
    "elements": {
        "bar": ("exact impact of two bars, observed orders", "test_truth.py::test_orders_on_hunek"),
        "green-bar": (
            "no force in a rigid rotation, `bar` at small strains",
            "test_parts_of_bodies.py::test_a_rigid_rotation_leaves_a_green_bar_without_force",
        ),
        "quadratic-bar": (
            "both branches of its dispersion relation, highest frequency in closed form",
            "test_cells.py::test_modes_of_quadratic_bars_lie_on_both_branches_of_the_dispersion_relation",
        ),
        "quad4": (
            "bars without lateral contraction, exact; critical steps of an independent program",
            "test_bars_of_cells.py::test_critical_steps_are_those_of_an_independent_program",
        ),
        "tri3": (
            "bars with an error of the first order; critical steps of an independent program",
            "test_solids.py::test_triangles_tend_to_the_bar_with_the_first_order",
        ),
        "hex8": (
            "bars without lateral contraction, exact; critical steps of an independent program",
            "test_bars_of_cells.py::test_bodies_that_nothing_strains_across_are_bars",
        ),
        "tet4": (
            "bars with an error of the first order; critical steps of an independent program",
            "test_space.py::test_the_error_of_tetrahedra_is_of_the_first_order",
        ),
        "quad4-one-point": (
            "the dense form of its stiffness; beams of Euler and Bernoulli; bars without lateral contraction, exact",
            "test_one_point.py::test_a_slender_beam_bends_as_that_of_euler_and_bernoulli",
        ),
        "hex8-one-point": (
            "the dense form of its stiffness; beams of Euler and Bernoulli; bars without lateral contraction, exact",
            "test_one_point.py::test_the_stiffness_is_that_of_the_mean_strain_and_of_the_dense_hourglass_form",
        ),
        "quad4-axisymmetric": (
            "cylinders that are bars, exact; critical steps and a ball on a wall of independent programs",
            "test_disk.py::test_a_ball_on_a_wall_over_the_ball_of_hertz",
        ),
        "tri3-axisymmetric": (
            "the ball of quadrilaterals",
            "test_disk.py::test_a_ball_of_triangles_is_near_that_of_quadrilaterals",
        ),
        "spectral-bar": (
            "highest frequencies in closed form, errors of frequencies of twice the order",
            "test_cells.py::test_the_error_of_a_frequency_is_of_twice_the_order",
        ),
    },
    "materials": {
        "bilinear-plastic": (
            "elastic and plastic wave from an impact on a wall, exact",
            "test_state_variables.py::test_a_plastic_bar_presses_a_wall_with_the_force_of_its_two_waves",
        ),
        "elastic": ("exact impact of two bars, observed orders", "test_truth.py::test_orders_on_hunek"),
        "ramberg-osgood": (
            "the equation of Ramberg and Osgood, and its integral",
            "test_parts_of_bodies.py::test_the_stress_of_ramberg_and_osgood_solves_their_equation",
        ),
    },
}


def facts(family: str, registry: Registry) -> Iterator[tuple[str, ...]]:
    """Yield name, order and limit (of an integrator), declared properties, truth and test of each method."""
    for name in registry.names(family):
        against, test = HELD[family][name]
        cls: Any = registry.get(family, name)
        limit = f"{cls.critical_courant:.3g}" if getattr(cls, "critical_courant", None) else ""
        kept = ", ".join([*getattr(cls, "conserves", ()), *getattr(cls, "guarantees", ())])
        file, _, function = test.partition("::")
        yield (
            f"`{name}`",
            *((str(cls.order), limit) if family == "integrators" else ()),
            kept,
            f"{against}: [`{function}`](../tests/truth/{file})",
        )


def tests_named() -> Iterator[tuple[Path, str]]:
    """Yield the file and the name of each test that the table names."""
    for held in HELD.values():
        for _, test in held.values():
            file, _, function = test.partition("::")
            yield places.ROOT / "tests" / "truth" / file, function
