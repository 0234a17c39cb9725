/* Embree 4's changed entry points, in terms of Embree 3's. Per ray: a handful of moves. */
#include "on3.h"
#include <assert.h>

/* The declarations that on3.h renamed, back on the library's symbols. */
#define LIBRARY(name) extern __typeof__(embree3_##name) embree3_##name __asm__(#name)
LIBRARY(rtcIntersect1); LIBRARY(rtcIntersect4); LIBRARY(rtcIntersect8); LIBRARY(rtcIntersect16);
LIBRARY(rtcOccluded1);  LIBRARY(rtcOccluded4);  LIBRARY(rtcOccluded8);  LIBRARY(rtcOccluded16);
LIBRARY(rtcNewGeometry);

/* v3 keeps in the context what v4 keeps in the arguments. The caller's context is needed
   as it is (callbacks get that very pointer, and reach their own data behind it), so its
   two fields are set for the call; they are put back for a query within a callback that
   passes its own context on. */
struct saved { struct RTCRayQueryContext* context; enum RTCIntersectContextFlags flags; RTCFilterFunctionN filter; };

static inline struct saved enter(struct RTCRayQueryContext* own, struct RTCRayQueryContext* context,
                                 unsigned int flags, RTCFilterFunctionN filter)
{
  struct saved s;
  if (!context) {
    rtcInitIntersectContext(own);
    context = own;
  }
  s.context = context;
  s.flags = context->flags;
  s.filter = context->filter;
  context->flags = (flags & RTC_RAY_QUERY_FLAG_COHERENT) ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  /* v4 asks the geometries unless the query says "all"; v3 always asks all. */
  context->filter = (flags & RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER) ? filter : NULL;
  return s;
}

static inline void leave(struct saved s)
{
  s.context->flags = s.flags;
  s.context->filter = s.filter;
}

#define QUERY(call, callback)                                                          \
  struct RTCRayQueryContext own;                                                       \
  struct saved s;                                                                      \
  if (args) {                                                                          \
    assert(!args->callback && "Embree 3 has no user geometry callbacks in arguments"); \
    s = enter(&own, args->context, args->flags, args->filter);                         \
  } else {                                                                             \
    s = enter(&own, NULL, 0, NULL);                                                    \
  }                                                                                    \
  call;                                                                                \
  leave(s)

void rtcIntersect1(RTCScene scene, struct RTCRayHit* r, struct RTCIntersectArguments* args)
{ QUERY(embree3_rtcIntersect1(scene, s.context, r), intersect); }
void rtcOccluded1(RTCScene scene, struct RTCRay* r, struct RTCOccludedArguments* args)
{ QUERY(embree3_rtcOccluded1(scene, s.context, r), occluded); }

#define PACKET(n)                                                                                                   \
  void rtcIntersect##n(const int* valid, RTCScene scene, struct RTCRayHit##n* r, struct RTCIntersectArguments* args) \
  { QUERY(embree3_rtcIntersect##n(valid, scene, s.context, r), intersect); }                                        \
  void rtcOccluded##n(const int* valid, RTCScene scene, struct RTCRay##n* r, struct RTCOccludedArguments* args)      \
  { QUERY(embree3_rtcOccluded##n(valid, scene, s.context, r), occluded); }
PACKET(4)
PACKET(8)
PACKET(16)

/* As in 4: the callback's ray goes on in another scene, under instID, with the query's own
   context and filter. Only org, tnear, dir and time are taken from *with. */
struct path { float org_tnear[4], dir_time[4]; };
static inline struct path take(struct RTCRay* to, const struct RTCRay* with)
{
  struct path old = {{to->org_x, to->org_y, to->org_z, to->tnear}, {to->dir_x, to->dir_y, to->dir_z, to->time}};
  to->org_x = with->org_x; to->org_y = with->org_y; to->org_z = with->org_z; to->tnear = with->tnear;
  to->dir_x = with->dir_x; to->dir_y = with->dir_y; to->dir_z = with->dir_z; to->time = with->time;
  return old;
}
static inline void put_back(struct RTCRay* to, const struct path* old)
{
  to->org_x = old->org_tnear[0]; to->org_y = old->org_tnear[1]; to->org_z = old->org_tnear[2]; to->tnear = old->org_tnear[3];
  to->dir_x = old->dir_time[0]; to->dir_y = old->dir_time[1]; to->dir_z = old->dir_time[2]; to->time = old->dir_time[3];
}

/* 4 with one instance level: a push on a full stack changes nothing, a pop empties it. */
static inline void push(struct RTCRayQueryContext* c, unsigned int instID)
{ if (c->instID[0] == RTC_INVALID_GEOMETRY_ID) c->instID[0] = instID; }
static inline void pop(struct RTCRayQueryContext* c)
{ c->instID[0] = RTC_INVALID_GEOMETRY_ID; }
_Static_assert(RTC_MAX_INSTANCE_LEVEL_COUNT == 1, "the forwards are written for one instance level");

void rtcForwardIntersect1(const struct RTCIntersectFunctionNArguments* args, RTCScene scene, struct RTCRay* with, unsigned int instID)
{
  struct RTCRayHit* r = (struct RTCRayHit*) args->rayhit;
  struct path old = take(&r->ray, with);
  push(args->context, instID);
  embree3_rtcIntersect1(scene, args->context, r);
  pop(args->context);
  put_back(&r->ray, &old);
}

void rtcForwardOccluded1(const struct RTCOccludedFunctionNArguments* args, RTCScene scene, struct RTCRay* with, unsigned int instID)
{
  struct RTCRay* r = (struct RTCRay*) args->ray;
  struct path old = take(r, with);
  push(args->context, instID);
  embree3_rtcOccluded1(scene, args->context, r);
  pop(args->context);
  put_back(r, &old);
}

/* v3's call runs the geometry's filter and then the query's; v4's only the former. */
void rtcInvokeIntersectFilterFromGeometry(const struct RTCIntersectFunctionNArguments* args, const struct RTCFilterFunctionNArguments* filter)
{
  RTCFilterFunctionN of_query = args->context->filter;
  args->context->filter = NULL;
  rtcFilterIntersection(args, filter);
  args->context->filter = of_query;
}

void rtcInvokeOccludedFilterFromGeometry(const struct RTCOccludedFunctionNArguments* args, const struct RTCFilterFunctionNArguments* filter)
{
  RTCFilterFunctionN of_query = args->context->filter;
  args->context->filter = NULL;
  rtcFilterOcclusion(args, filter);
  args->context->filter = of_query;
}

/* v3's geometries start with all mask bits set, v4's with the lowest only. */
RTCGeometry rtcNewGeometry(RTCDevice device, enum RTCGeometryType type)
{
  RTCGeometry geometry = embree3_rtcNewGeometry(device, type);
  if (geometry)
    rtcSetGeometryMask(geometry, 1);
  return geometry;
}

void* rtcGetGeometryUserDataFromScene(RTCScene scene, unsigned int geomID)
{ return rtcGetGeometryUserData(rtcGetGeometry(scene, geomID)); }

void rtcGetGeometryTransformFromScene(RTCScene scene, unsigned int geomID, float time, enum RTCFormat format, void* xfm)
{ rtcGetGeometryTransform(rtcGetGeometry(scene, geomID), time, format, xfm); }

const char* rtcGetErrorString(enum RTCError error)
{
  switch (error) {
  case RTC_ERROR_NONE: return "No Error";
  case RTC_ERROR_UNKNOWN: return "Unknown error";
  case RTC_ERROR_INVALID_ARGUMENT: return "Invalid argument";
  case RTC_ERROR_INVALID_OPERATION: return "Invalid operation";
  case RTC_ERROR_OUT_OF_MEMORY: return "Out of Memory";
  case RTC_ERROR_UNSUPPORTED_CPU: return "Unsupported CPU";
  case RTC_ERROR_CANCELLED: return "Build cancelled";
  }
  return "Invalid error code";
}
