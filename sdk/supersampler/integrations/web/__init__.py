"""The page that upscales in a browser: written as a static folder, and served on this machine.

Its own files are in examples/web; the wheel has them here, in page/.
"""

from supersampler.integrations.web.server import serving
from supersampler.integrations.web.site import PACKAGES, site_files, write_site

__all__ = ["PACKAGES", "serving", "site_files", "write_site"]
