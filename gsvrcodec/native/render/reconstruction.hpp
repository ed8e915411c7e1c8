// The constants of reconstruction (spec/gsvr.md, section "Reconstruction"). The same numbers stand
// in gsvrcodec/model/reconstruction.py; a test compares them.
#pragma once

namespace gsvr {

constexpr float kMinScale = 0.1f;        // px of the coded frame
constexpr float kDilation = 0.1f;        // px^2 of the coded frame, added to variances on level 0
constexpr float kCutoff = 1.0f / 64.0f;  // subtracted from each weight
constexpr float kSupport = 4.1588830833596715f;  // ln 64: the exponent where the cut-off is reached
constexpr float kGround = 1.0f / 1024.0f;        // weight of the black ground of a mean
constexpr float kPlateWeight = 1.0f;             // of each pixel of a plate
constexpr float kMostLogOpacity = 12.0f;         // greatest magnitude of a log-opacity at any time
constexpr float kAntialias = 0.25f;              // px^2 of a frame smaller than the coded one

// The pyramid: level l has 1/2^l of the frame's width and height.
constexpr int kLevels = 5;
constexpr float kLevelScale = 1.0f;     // px of a level above 0: the smallest scale drawn there
constexpr float kUpsampling = 0.1875f;  // px^2 of a level: the variance added by upsampling
constexpr float kMinVariance = 0.5f;    // px^2 of a level above 0

}  // namespace gsvr
