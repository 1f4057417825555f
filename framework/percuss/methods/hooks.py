"""The marks of the functions with which a package registers its methods.

There is one hook for each family: ``percuss_integrators``, ``percuss_contacts`` and so on. A hook takes no argument and
returns component classes.
"""

import pluggy

GROUP = "percuss"
hookimpl = pluggy.HookimplMarker(GROUP)
hookspec = pluggy.HookspecMarker(GROUP)
