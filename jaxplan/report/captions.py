"""Captions of the figures along the orbit, which pages on single manoeuvres and on timelines share."""

ALONG_ORBIT = {
    "orbital_sphere": "The sphere in the local orbital frame, which turns with the spacecraft: the half "
    "sphere about nadir, with the Earth to its limb, and that about the zenith, on both ahead up and the "
    "right to the right. What stands still in space moves in it.",
    "attitude": "The body in that frame (x about along the velocity, y against the orbit's normal, z to "
    "nadir), by yaw, then pitch, then roll; and how far boresights are from nadir.",
    "ground_track": "Where the spacecraft is overhead, and where boresights meet the ellipsoid of WGS 84.",
}
