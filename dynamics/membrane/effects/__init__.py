"""Effects on a membrane, one file each, and the list of them: a new effect is a file and a line here.

An effect is a module with

    NAME         its name among the parameters (`model.effects.NAME`) and work arrays (`work.effects.NAME`)
    PLAN         of each of its names in the plan a function (scene, plan so far) → `interface.Decision`
    COST         in words, what it costs where it is on
    build        from `interface.Setup` to its parameters, a named tuple; arrays are empty where it is off
    work         from the model to its work arrays, a named tuple, which checkpoints keep
    COLUMNS      its columns of the record: how many numbers, and their unit

and of these functions, compiled with `@interface.hook`, those that it needs (see `composition`). They are asked in the
order of the list, and return at once where the effect is off:

    acts_each_step(model)                            does it act in each step, so that none can be taken several at once
    lengthen(model, work, temperature)               write free lengths at new temperatures
    relight(model, work, x, t)                       add to the light that triangles hold
    accelerate(model, work, x, v, t)                 add to work.acceleration (3, n) in m/s²
    heat(model, work, x, temperature)                add to work.effects.heat.rate (n,), in W until all have added
    write(model, work, state, centre, row)           write its own columns, a part of the row; centre (3,) of mass

Forces of springs and sheet and the held light are summed row by row (`layout.sweep`), many steps at once and by several
threads; what fails is found there. Step and threads call these three by name. The step moves the masses on `tethers`
with the nodes.
"""

from types import ModuleType

from dynamics.membrane.effects import (
    damping,
    held,
    light_pressure,
    properties,
    reflections,
    sheet,
    spin,
    springs,
    tearing,
    tethers,
    thermal,
)

EFFECTS: tuple[ModuleType, ...] = (
    light_pressure,
    reflections,
    spin,
    thermal,
    springs,
    sheet,
    properties,
    damping,
    held,
    tethers,
    tearing,
)
