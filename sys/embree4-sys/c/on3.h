/* Embree 4 names on top of Embree 3.13.

   The v3 functions whose meaning changed in v4 are declared under embree3_*; the v4
   ones are declared under their own names here, defined in on3.c, and carry link names
   of their own, so that they never meet libembree3's symbols of the same name. */
#ifndef EMBREE4_ON_3_H
#define EMBREE4_ON_3_H

/* v3's context keeps its layout and takes v4's name. User code gets to know instID only:
   flags and filter belong to the compat layer. */
#define RTCIntersectContext RTCRayQueryContext

#define rtcIntersect1         embree3_rtcIntersect1
#define rtcIntersect4         embree3_rtcIntersect4
#define rtcIntersect8         embree3_rtcIntersect8
#define rtcIntersect16        embree3_rtcIntersect16
#define rtcOccluded1          embree3_rtcOccluded1
#define rtcOccluded4          embree3_rtcOccluded4
#define rtcOccluded8          embree3_rtcOccluded8
#define rtcOccluded16         embree3_rtcOccluded16
#define rtcNewGeometry        embree3_rtcNewGeometry
#include <embree3/rtcore.h>
#undef rtcIntersect1
#undef rtcIntersect4
#undef rtcIntersect8
#undef rtcIntersect16
#undef rtcOccluded1
#undef rtcOccluded4
#undef rtcOccluded8
#undef rtcOccluded16
#undef rtcNewGeometry

#if RTC_VERSION_MAJOR != 3 || RTC_VERSION_MINOR < 13
#  error "the compat layer is written for Embree 3.13"
#endif
#if RTC_MIN_WIDTH
#  error "the compat layer does not know Embree 3's min-width feature"
#endif

/* --- types and constants new in 4 (values as in 4.3) --- */

enum RTCRayQueryFlags
{
  RTC_RAY_QUERY_FLAG_NONE                   = 0,
  RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER = 1 << 1,
  RTC_RAY_QUERY_FLAG_INCOHERENT             = 0 << 16,
  RTC_RAY_QUERY_FLAG_COHERENT               = 1 << 16
};

/* Only means something to GPUs; ALL is what rtcInit*Arguments set. */
enum RTCFeatureFlags
{
  RTC_FEATURE_FLAG_NONE = 0,
  RTC_FEATURE_FLAG_ALL  = 0xffffffff
};

enum
{
  RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION
};

struct RTCIntersectArguments
{
  enum RTCRayQueryFlags flags;
  enum RTCFeatureFlags feature_mask;
  struct RTCRayQueryContext* context;
  RTCFilterFunctionN filter;
  RTCIntersectFunctionN intersect; /* must stay NULL: v3 knows only the geometry's callback */
};

struct RTCOccludedArguments
{
  enum RTCRayQueryFlags flags;
  enum RTCFeatureFlags feature_mask;
  struct RTCRayQueryContext* context;
  RTCFilterFunctionN filter;
  RTCOccludedFunctionN occluded; /* must stay NULL */
};

/* --- v4 entry points --- */

#define ON3(name) __asm__("embree4_on_3_" #name)

void rtcIntersect1 (RTCScene, struct RTCRayHit*, struct RTCIntersectArguments*) ON3(rtcIntersect1);
void rtcIntersect4 (const int* valid, RTCScene, struct RTCRayHit4*,  struct RTCIntersectArguments*) ON3(rtcIntersect4);
void rtcIntersect8 (const int* valid, RTCScene, struct RTCRayHit8*,  struct RTCIntersectArguments*) ON3(rtcIntersect8);
void rtcIntersect16(const int* valid, RTCScene, struct RTCRayHit16*, struct RTCIntersectArguments*) ON3(rtcIntersect16);
void rtcOccluded1 (RTCScene, struct RTCRay*, struct RTCOccludedArguments*) ON3(rtcOccluded1);
void rtcOccluded4 (const int* valid, RTCScene, struct RTCRay4*,  struct RTCOccludedArguments*) ON3(rtcOccluded4);
void rtcOccluded8 (const int* valid, RTCScene, struct RTCRay8*,  struct RTCOccludedArguments*) ON3(rtcOccluded8);
void rtcOccluded16(const int* valid, RTCScene, struct RTCRay16*, struct RTCOccludedArguments*) ON3(rtcOccluded16);

void rtcForwardIntersect1(const struct RTCIntersectFunctionNArguments*, RTCScene, struct RTCRay*, unsigned int instID) ON3(rtcForwardIntersect1);
void rtcForwardOccluded1 (const struct RTCOccludedFunctionNArguments*,  RTCScene, struct RTCRay*, unsigned int instID) ON3(rtcForwardOccluded1);

void rtcInvokeIntersectFilterFromGeometry(const struct RTCIntersectFunctionNArguments*, const struct RTCFilterFunctionNArguments*) ON3(rtcInvokeIntersectFilterFromGeometry);
void rtcInvokeOccludedFilterFromGeometry (const struct RTCOccludedFunctionNArguments*,  const struct RTCFilterFunctionNArguments*) ON3(rtcInvokeOccludedFilterFromGeometry);

RTCGeometry rtcNewGeometry(RTCDevice, enum RTCGeometryType) ON3(rtcNewGeometry);
void* rtcGetGeometryUserDataFromScene(RTCScene, unsigned int geomID) ON3(rtcGetGeometryUserDataFromScene);
void rtcGetGeometryTransformFromScene(RTCScene, unsigned int geomID, float time, enum RTCFormat, void* xfm) ON3(rtcGetGeometryTransformFromScene);
const char* rtcGetErrorString(enum RTCError) ON3(rtcGetErrorString);

#endif
