"""Speed against error of the choices that the code has made: no user can change them."""
