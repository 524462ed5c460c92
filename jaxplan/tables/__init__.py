"""Tables of attitudes: read back, and proved as their readers fly them."""

from jaxplan.tables.files import load_attitude
from jaxplan.tables.interpolation import sampled
from jaxplan.tables.proof import TableCertificate, certify_table
from jaxplan.tables.table import INTERPOLATIONS, AttitudeTable

__all__ = ["INTERPOLATIONS", "AttitudeTable", "TableCertificate", "certify_table", "load_attitude", "sampled"]
