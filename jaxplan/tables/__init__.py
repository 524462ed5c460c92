"""Tables of attitudes: reading them from files, and proving what they keep when other programs use them."""

from jaxplan.tables.files import load_attitude
from jaxplan.tables.interpolation import sampled
from jaxplan.tables.proof import TableCertificate, certify_table
from jaxplan.tables.table import INTERPOLATIONS, AttitudeTable

__all__ = ["INTERPOLATIONS", "AttitudeTable", "TableCertificate", "certify_table", "load_attitude", "sampled"]
