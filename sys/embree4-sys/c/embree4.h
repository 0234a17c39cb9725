/* Embree 4's API, whichever Embree is installed: the one header that bindgen and the
   compat layer read. */
#ifndef EMBREE4_SYS_H
#define EMBREE4_SYS_H

#if __has_include(<embree4/rtcore.h>) && !defined(EMBREE4_SYS_FORCE_3)
#  include <embree4/rtcore.h>
#  define EMBREE4_SYS_NATIVE 4
#elif __has_include(<embree3/rtcore.h>)
#  include "on3.h"
#  define EMBREE4_SYS_NATIVE 3
#else
#  error "no Embree headers found (Debian: apt-get install libembree-dev)"
#endif

#endif
