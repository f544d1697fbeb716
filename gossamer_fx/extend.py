"""What an own item, load, law, probe, output or chamber is made of: the promised interface for
extensions.

Names of this module do not change their meaning from one minor version to the next; everything else
below the rooms of the package may move.  The orbit room is written against this module and other
public names only, as the proof that it suffices.

Parts of a scene
    `Item`, the base of all that a scene is made of, which yields each `Term`; what else an item
    may be: `Body`, `Group`, `InitialCondition`, `Sampled`, `BringsScalarUnknowns` with
    `ScalarUnknowns` and `ScalarTotals`
    where bodies are: `State`, `InitialState`, `BodyState`
    bodies, and what is attached to them: `MeshBody`, `Block`, `Port`, `Ground`, `Attached`; films
    that `gx.reduction.reduce` has made are a `ReducedMembrane`
General kinds of terms
    on meshes, in UFL (`Expr`, `constant`): `KineticEnergy`, `StoredEnergy`, `QuadraticEnergy`,
    `ViscousDissipation`, `Load`
    between points: `PointMeasure` with `PointConstraint`, or with `Rows`, whose law is a plain
    function with a `Response` that is compiled with its derivatives; `PointLoad`,
    `AttachedKineticEnergy`
    fixed and prescribed coordinates: `Support`
    the law of a `PointLoad`: `PointForce`; with gradients where it depends on the start of a step
    `ForceOfStart`, and with history variables `HistoryVariables`, of which ranks share out
    `NamedRows`
Laws and obstacles
    `FilmLaw`, the base of laws of films, `IsotropicFilm` of those with two moduli; pieces of a path
    of strain are `Piece` with `within_cone`, and a plate needs the law's `BendingStiffness`;
    numbers that vary over a film are a `Property`; `half_trace_and_radius` of Mohr's circle
    `Folding`, the base of fold maps, `Folded`, the start that one makes, and lines that are `Bent`
    `Obstacle`, that of what contact keeps films off: its parts are `ObstacleBoundary` and
    `ObstacleSolid`, of the stencils `PointPlane`, `EdgeEdge`, or own ones: `LawBoundary`, whose
    distance is a plain function, `BoundaryStencil`, `PairStencil`; its picture is a `DrawnSurface`
    `line_derivative`, `area_vector` for measures in UFL
    what plain functions may use that are compiled: `at_most`, `root`, `positive_part`,
    `one_sided_average`, `Number`; `compile_law` compiles them for own kinds of terms, and
    `LawOfRows` for a `Stencil`
Own kinds of terms
    `CompiledTerms`, the base of their compilers, and its `Assembly`, the system as they see it;
    facets that a compiler may have: `Multipliers`, `ActiveSet`, `HistoryVariables`,
    `Differentiable`, `Shown`
    what it computes with: `Coordinates`, `NumberedBlock`, `compile_form`, `compile_expression`;
    `PointMeasures`, `Gather`, `add_blocks`, `attach_all`
Gas
    the bases of items: `Holder` of boundaries, `Volume`, `Opening`, `DynamicOpening` with state
    variables, `PassiveOpening` of one law for both directions, `Wall`, `Enclosure`;
    `CompiledEnclosure`, `CompiledWall`; the
    `GasNetwork` that openings name as their `scalar_unknowns`; `isentropic_flow`
Steppers
    `Stepper`; `StepSolver`, whose result is a `Step`; `StressRule`, which may use
    `energy_gradient` and `energy_correction`
Runs
    `StateView`, `HasSystem`, `Output` with the `Schedule` of its records, `Probe`, and `Objective`,
    the base of results with derivatives; `STATES` of films by name with their `STATE_COLOURS`
Studies
    `CaseSet` of cases that are run, kept and judged: `run_cases`, `Result`, `Judgement`, `verdict`,
    `changes` against stored results, `read_results`, `write_results`; `recorded_warnings`;
    `one_at_a_time` the values that are varied, and `SPREAD_LIMIT`, how far an answer may move
    tables and pictures: `markdown_table`, `number_text`, `values_text`, `observed_order`,
    `ErrorCurve` with `draw_error_curves`
    what is measured: `relative_drift`, `FieldFunctions`, `AreaFractions`
    constants of flight: `AU` [m], `EARTH_MU` [m³/s²], `EARTH_RADIUS` [m], `EARTH_J2`
Checks
    `check`, `check_on_all`, `check_positive`, `check_known`, `check_in_scene`, `is_vector`, `ask`,
    `ask_numbers`, `ask_points`,
    `InputError`, `errors_as_sentences` for programs; `check_arguments` with the marks `positive`,
    `not_negative`, `Range`, `Count`, `at_least`, `RISING`, `NOT_ZERO`, or an own `Mark`; with
    relations between arguments: `exactly_one`, `at_most_one`, `both_or_none`, `only_with`, `some`,
    `as_many`, `rising`, `below`, `different`
"""

from gossamer_fx.core.checks.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names("gossamer_fx", __file__, module=__name__)
