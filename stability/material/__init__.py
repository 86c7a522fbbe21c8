"""Sets of loops as a material point: stress and tangent at the end of a step of strain."""

from stability.material.blocks import MaterialState as MaterialState
from stability.material.loop_material import LoopMaterial as LoopMaterial
from stability.material.loop_material import MaterialResponse as MaterialResponse
from stability.material.loop_set import LoopSet as LoopSet
from stability.material.loop_set import loops_of as loops_of
from stability.material.loop_set import oriented as oriented
from stability.material.march import MaterialPath as MaterialPath
from stability.material.march import march as march
