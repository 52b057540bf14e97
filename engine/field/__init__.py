"""The field: HexPlane, Z_kin, and the branches that decode it."""

from degense.engine.field.config import ROUTINGS, FieldConfig, Routing
from degense.engine.field.model import SceneModel, State

__all__ = ["ROUTINGS", "FieldConfig", "Routing", "SceneModel", "State"]
