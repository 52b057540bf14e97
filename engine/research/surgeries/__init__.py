"""A family of synthetic surgeries: every seed draws its own anatomy, light, motion and events, with exact truth.

To import it adds the kind "family" to `engine.data.synthetic.scene.KINDS`. Settings are chosen on the seeds `DEVELOP`; nothing is ever
chosen on the seeds `REPORT`.
"""

from degense.engine.data.synthetic.scene import KINDS
from degense.engine.research.surgeries.plan import DEVELOP, REPORT, SurgeryPlan, draw_plan
from degense.engine.research.surgeries.surgery import Surgery

__all__ = ["DEVELOP", "REPORT", "Surgery", "SurgeryPlan", "draw_plan"]

KINDS["family"] = Surgery
