"""Skeletons of other programs, bone by bone: what each hangs on, where it is, and which role it plays."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body.skeleton_motion import RestSkeleton

_LEFT = {
    "s": "l",
    "S": "L",
    "Side": "Left",
    "side": "left",
    "f": "lf",
    "jp": "左",
    "es": "izq",
    "fr": "gauche",
    "it": "sx",
    "ru": "Л",
}
_RIGHT = {
    "s": "r",
    "S": "R",
    "Side": "Right",
    "side": "right",
    "f": "rt",
    "jp": "右",
    "es": "der",
    "fr": "droite",
    "it": "dx",
    "ru": "П",
}


def _points(droop: float) -> dict[str, np.ndarray]:
    """Joints of a human of 1.75 m, the left side's, arms lowered by an angle."""
    along = np.array([np.cos(droop), 0.0, -np.sin(droop)])
    shoulder = np.array([0.18, 0.02, 1.42])
    found = {
        "ground": (0.0, 0.0, 0.0),
        "hips": (0.0, 0.0, 0.95),
        "spine1": (0.0, 0.01, 1.03),
        "spine2": (0.0, 0.02, 1.14),
        "spine3": (0.0, 0.02, 1.26),
        "neck": (0.0, 0.02, 1.45),
        "nape": (0.0, 0.01, 1.50),
        "head": (0.0, 0.0, 1.54),
        "top": (0.0, 0.0, 1.75),
        "face": (0.03, -0.09, 1.62),
        "collar": (0.03, 0.02, 1.42),
        "shoulder": shoulder,
        "armtwist": shoulder + 0.14 * along,
        "elbow": shoulder + 0.28 * along,
        "foretwist": shoulder + 0.40 * along,
        "wrist": shoulder + 0.53 * along,
        "palm": shoulder + 0.58 * along,
        "thigh": (0.095, 0.0, 0.92),
        "thightwist": (0.095, 0.0, 0.70),
        "knee": (0.095, -0.01, 0.49),
        "shintwist": (0.095, 0.0, 0.30),
        "ankle": (0.095, 0.015, 0.07),
        "ball": (0.1, -0.115, 0.02),
        "tiptoe": (0.1, -0.185, 0.02),
    }
    for finger, ahead in (("thumb", 0.04), ("index", 0.03), ("middle", 0.01), ("ring", -0.01), ("pinky", -0.03)):
        for k in range(3):
            base = 0.53 + (0.03 if finger == "thumb" else 0.09) + 0.03 * k
            found[f"{finger}{k}"] = shoulder + base * along + [0.0, -ahead, 0.0]
    return {name: np.array(at) for name, at in found.items()}


SKELETONS = {
    "xps": """
        root ground | | ground
        root hips | root ground | hips | hips
        pelvis | root hips | hips
        leg {side} thigh | root hips | thigh | thigh
        leg {side} knee | leg {side} thigh | knee | shin
        leg {side} ankle | leg {side} knee | ankle | foot
        leg {side} toes | leg {side} ankle | ball | toe
        spine lower | root hips | spine1 | spine
        spine middle | spine lower | spine2 | spine
        spine upper | spine middle | spine3 | spine
        arm {side} shoulder 1 | spine upper | collar | shoulder
        arm {side} shoulder 2 | arm {side} shoulder 1 | shoulder | upper_arm
        arm {side} elbow | arm {side} shoulder 2 | elbow | forearm
        arm {side} wrist | arm {side} elbow | wrist | hand
        head neck lower | spine upper | neck | neck
        head neck upper | head neck lower | head | head
        head jaw | head neck upper | face
        """,
    "mgear": """
        body_C0_root_jnt | | ground
        spine_C0_pelvis_jnt | body_C0_root_jnt | hips | hips
        leg_{S}0_0_jnt | spine_C0_pelvis_jnt | thigh | thigh
        leg_{S}0_1_jnt | leg_{S}0_0_jnt | knee | shin
        leg_{S}0_end_jnt | leg_{S}0_1_jnt | ankle | foot
        foot_{S}0_0_jnt | leg_{S}0_end_jnt | ball | toe
        spine_C0_01_jnt | spine_C0_pelvis_jnt | spine1 | spine
        spine_C0_02_jnt | spine_C0_01_jnt | spine3 | spine
        shoulder_{S}0_shoulder_jnt | spine_C0_02_jnt | collar | shoulder
        arm_{S}0_0_jnt | shoulder_{S}0_shoulder_jnt | shoulder | upper_arm
        arm_{S}0_1_jnt | arm_{S}0_0_jnt | elbow | forearm
        arm_{S}0_end_jnt | arm_{S}0_1_jnt | wrist | hand
        neck_C0_0_jnt | spine_C0_02_jnt | neck | neck
        neck_C0_head_jnt | neck_C0_0_jnt | head | head
        """,
    "daz genesis 8": """
        hip | | hips | hips
        pelvis | hip | hips
        {s}ThighBend | pelvis | thigh | thigh
        {s}ThighTwist | {s}ThighBend | thightwist
        {s}Shin | {s}ThighTwist | knee | shin
        {s}Foot | {s}Shin | ankle | foot
        {s}Metatarsals | {s}Foot | ankle
        {s}Toe | {s}Metatarsals | ball | toe
        {s}BigToe | {s}Toe | tiptoe
        abdomenLower | hip | spine1 | spine
        abdomenUpper | abdomenLower | spine2 | spine
        chestLower | abdomenUpper | spine3 | spine
        chestUpper | chestLower | neck | spine
        {s}Pectoral | chestLower | face
        {s}Collar | chestUpper | collar | shoulder
        {s}ShldrBend | {s}Collar | shoulder | upper_arm
        {s}ShldrTwist | {s}ShldrBend | armtwist
        {s}ForearmBend | {s}ShldrTwist | elbow | forearm
        {s}ForearmTwist | {s}ForearmBend | foretwist
        {s}Hand | {s}ForearmTwist | wrist | hand
        {s}Carpal1 | {s}Hand | palm
        {s}Index1 | {s}Carpal1 | index0 | index
        {s}Index2 | {s}Index1 | index1 | index
        {s}Index3 | {s}Index2 | index2 | index
        neckLower | chestUpper | neck | neck
        neckUpper | neckLower | nape | neck
        head | neckUpper | head | head
        {s}Eye | head | face
        """,
    "reallusion": """
        CC_Base_BoneRoot | | ground
        CC_Base_Hip | CC_Base_BoneRoot | hips | hips
        CC_Base_Pelvis | CC_Base_Hip | hips
        CC_Base_{S}_Thigh | CC_Base_Pelvis | thigh | thigh
        CC_Base_{S}_ThighTwist01 | CC_Base_{S}_Thigh | thightwist
        CC_Base_{S}_Calf | CC_Base_{S}_Thigh | knee | shin
        CC_Base_{S}_KneeShareBone | CC_Base_{S}_Calf | knee
        CC_Base_{S}_CalfTwist01 | CC_Base_{S}_Calf | shintwist
        CC_Base_{S}_Foot | CC_Base_{S}_Calf | ankle | foot
        CC_Base_{S}_ToeBaseShareBone | CC_Base_{S}_Foot | ball
        CC_Base_{S}_ToeBase | CC_Base_{S}_Foot | ball | toe
        CC_Base_{S}_BigToe1 | CC_Base_{S}_ToeBase | tiptoe
        CC_Base_Waist | CC_Base_Hip | spine1 | spine
        CC_Base_Spine01 | CC_Base_Waist | spine2 | spine
        CC_Base_Spine02 | CC_Base_Spine01 | spine3 | spine
        CC_Base_{S}_RibsTwist | CC_Base_Spine02 | face
        CC_Base_{S}_Clavicle | CC_Base_Spine02 | collar | shoulder
        CC_Base_{S}_Upperarm | CC_Base_{S}_Clavicle | shoulder | upper_arm
        CC_Base_{S}_UpperarmTwist01 | CC_Base_{S}_Upperarm | armtwist
        CC_Base_{S}_Forearm | CC_Base_{S}_Upperarm | elbow | forearm
        CC_Base_{S}_ElbowShareBone | CC_Base_{S}_Forearm | elbow
        CC_Base_{S}_Hand | CC_Base_{S}_Forearm | wrist | hand
        CC_Base_{S}_Mid1 | CC_Base_{S}_Hand | middle0 | middle
        CC_Base_{S}_Mid2 | CC_Base_{S}_Mid1 | middle1 | middle
        CC_Base_NeckTwist01 | CC_Base_Spine02 | neck | neck
        CC_Base_NeckTwist02 | CC_Base_NeckTwist01 | nape | neck
        CC_Base_Head | CC_Base_NeckTwist02 | head | head
        CC_Base_JawRoot | CC_Base_Head | face
        """,
    "biped": """
        Bip001 | | hips
        Bip001 Pelvis | Bip001 | hips | hips
        Bip001 Spine | Bip001 Pelvis | spine1 | spine
        Bip001 Spine1 | Bip001 Spine | spine2 | spine
        Bip001 {S} Thigh | Bip001 Spine | thigh | thigh
        Bip001 {S}ThighTwist | Bip001 {S} Thigh | thightwist
        Bip001 {S} Calf | Bip001 {S} Thigh | knee | shin
        Bip001 {S} Foot | Bip001 {S} Calf | ankle | foot
        Bip001 {S} Toe0 | Bip001 {S} Foot | ball | toe
        Bip001 {S} Toe0Nub | Bip001 {S} Toe0 | tiptoe
        Bip001 Neck | Bip001 Spine1 | neck | neck
        Bip001 {S} Clavicle | Bip001 Neck | collar | shoulder
        Bip001 {S} UpperArm | Bip001 {S} Clavicle | shoulder | upper_arm
        Bip001 {S} Forearm | Bip001 {S} UpperArm | elbow | forearm
        Bip001 {S} ForeTwist | Bip001 {S} Forearm | foretwist
        Bip001 {S} Hand | Bip001 {S} Forearm | wrist | hand
        Bip001 {S} Finger0 | Bip001 {S} Hand | thumb0 | thumb
        Bip001 {S} Finger01 | Bip001 {S} Finger0 | thumb1 | thumb
        Bip001 {S} Finger0Nub | Bip001 {S} Finger01 | thumb2
        Bip001 {S} Finger1 | Bip001 {S} Hand | index0 | index
        Bip001 {S} Finger11 | Bip001 {S} Finger1 | index1 | index
        Bip001 Head | Bip001 Neck | head | head
        Bip001 HeadNub | Bip001 Head | top
        """,
    "valve": """
        ValveBiped.Bip01_Pelvis | | hips | hips
        ValveBiped.Bip01_Spine | ValveBiped.Bip01_Pelvis | spine1 | spine
        ValveBiped.Bip01_Spine4 | ValveBiped.Bip01_Spine | spine3 | spine
        ValveBiped.Bip01_Neck1 | ValveBiped.Bip01_Spine4 | neck | neck
        ValveBiped.Bip01_Head1 | ValveBiped.Bip01_Neck1 | head | head
        ValveBiped.forward | ValveBiped.Bip01_Head1 | top
        ValveBiped.Bip01_{S}_Clavicle | ValveBiped.Bip01_Spine4 | collar | shoulder
        ValveBiped.Bip01_{S}_UpperArm | ValveBiped.Bip01_{S}_Clavicle | shoulder | upper_arm
        ValveBiped.Bip01_{S}_Forearm | ValveBiped.Bip01_{S}_UpperArm | elbow | forearm
        ValveBiped.Bip01_{S}_Hand | ValveBiped.Bip01_{S}_Forearm | wrist | hand
        ValveBiped.Bip01_{S}_Thigh | ValveBiped.Bip01_Pelvis | thigh | thigh
        ValveBiped.Bip01_{S}_Calf | ValveBiped.Bip01_{S}_Thigh | knee | shin
        ValveBiped.Bip01_{S}_Foot | ValveBiped.Bip01_{S}_Calf | ankle | foot
        ValveBiped.Bip01_{S}_Toe0 | ValveBiped.Bip01_{S}_Foot | ball | toe
        """,
    "mikumikudance": """
        全ての親 | | ground
        センター | 全ての親 | hips
        腰 | センター | hips | hips
        下半身 | 腰 | spine1
        上半身 | 腰 | spine1 | spine
        上半身2 | 上半身 | spine3 | spine
        首 | 上半身2 | neck | neck
        頭 | 首 | head | head
        {jp}肩P | 上半身2 | collar
        {jp}肩 | {jp}肩P | collar | shoulder
        {jp}腕 | {jp}肩 | shoulder | upper_arm
        {jp}腕捩 | {jp}腕 | armtwist
        {jp}ひじ | {jp}腕捩 | elbow | forearm
        {jp}手捩 | {jp}ひじ | foretwist
        {jp}手首 | {jp}手捩 | wrist | hand
        {jp}人指１ | {jp}手首 | index0
        {jp}足 | 下半身 | thigh | thigh
        {jp}ひざ | {jp}足 | knee | shin
        {jp}足首 | {jp}ひざ | ankle | foot
        {jp}つま先 | {jp}足首 | ball | toe
        {jp}足ＩＫ | 全ての親 | ankle
        {jp}足D | 下半身 | thigh
        {jp}ひざD | {jp}足D | knee
        """,
    "second life": """
        mPelvis | | hips | hips
        mTorso | mPelvis | spine1 | spine
        mChest | mTorso | spine3 | spine
        mNeck | mChest | neck | neck
        mHead | mNeck | head | head
        mSkull | mHead | top
        mCollar{Side} | mChest | collar | shoulder
        mShoulder{Side} | mCollar{Side} | shoulder | upper_arm
        mElbow{Side} | mShoulder{Side} | elbow | forearm
        mWrist{Side} | mElbow{Side} | wrist | hand
        mHip{Side} | mPelvis | thigh | thigh
        mKnee{Side} | mHip{Side} | knee | shin
        mAnkle{Side} | mKnee{Side} | ankle | foot
        mFoot{Side} | mAnkle{Side} | ball | toe
        mToe{Side} | mFoot{Side} | tiptoe
        """,
    "smpl": """
        Pelvis | | hips | hips
        {S}_Hip | Pelvis | thigh | thigh
        {S}_Knee | {S}_Hip | knee | shin
        {S}_Ankle | {S}_Knee | ankle | foot
        {S}_Foot | {S}_Ankle | ball | toe
        Spine1 | Pelvis | spine1 | spine
        Spine3 | Spine1 | spine3 | spine
        Neck | Spine3 | neck | neck
        Head | Neck | head | head
        {S}_Collar | Spine3 | collar | shoulder
        {S}_Shoulder | {S}_Collar | shoulder | upper_arm
        {S}_Elbow | {S}_Shoulder | elbow | forearm
        {S}_Wrist | {S}_Elbow | wrist | hand
        {S}_Hand | {S}_Wrist | palm
        """,
    "advanced skeleton": """
        Root_M | | hips | hips
        Spine1_M | Root_M | spine1 | spine
        Chest_M | Spine1_M | spine3 | spine
        Neck_M | Chest_M | neck | neck
        Head_M | Neck_M | head | head
        Scapula_{S} | Chest_M | collar | shoulder
        Shoulder_{S} | Scapula_{S} | shoulder | upper_arm
        ShoulderPart1_{S} | Shoulder_{S} | armtwist
        Elbow_{S} | ShoulderPart1_{S} | elbow | forearm
        Wrist_{S} | Elbow_{S} | wrist | hand
        Hip_{S} | Root_M | thigh | thigh
        Knee_{S} | Hip_{S} | knee | shin
        Ankle_{S} | Knee_{S} | ankle | foot
        Toes_{S} | Ankle_{S} | ball | toe
        """,
    "cmu": """
        Hips | | hips | hips
        {S}HipJoint | Hips | hips
        {Side}UpLeg | {S}HipJoint | thigh | thigh
        {Side}Leg | {Side}UpLeg | knee | shin
        {Side}Foot | {Side}Leg | ankle | foot
        {Side}ToeBase | {Side}Foot | ball | toe
        LowerBack | Hips | spine1 | spine
        Spine | LowerBack | spine2 | spine
        Spine1 | Spine | spine3 | spine
        Neck | Spine1 | neck | neck
        Neck1 | Neck | nape | neck
        Head | Neck1 | head | head
        {Side}Shoulder | Spine1 | collar | shoulder
        {Side}Arm | {Side}Shoulder | shoulder | upper_arm
        {Side}ForeArm | {Side}Arm | elbow | forearm
        {Side}Hand | {Side}ForeArm | wrist | hand
        {Side}FingerBase | {Side}Hand | palm
        {Side}HandIndex1 | {Side}FingerBase | index0
        """,
    "mb-lab, unreal but for the spine": """
        root | | ground | root
        pelvis | root | hips | hips
        thigh_{S} | pelvis | thigh | thigh
        thigh_twist_{S} | thigh_{S} | thightwist
        calf_{S} | thigh_{S} | knee | shin
        foot_{S} | calf_{S} | ankle | foot
        toes_{S} | foot_{S} | ball | toe
        spine01 | pelvis | spine1 | spine
        spine02 | spine01 | spine2 | spine
        spine03 | spine02 | spine3 | spine
        neck | spine03 | neck | neck
        head | neck | head | head
        clavicle_{S} | spine03 | collar | shoulder
        upperarm_{S} | clavicle_{S} | shoulder | upper_arm
        lowerarm_{S} | upperarm_{S} | elbow | forearm
        hand_{S} | lowerarm_{S} | wrist | hand
        """,
    "auto-rig pro's controls alone": """
        c_pos | | ground
        c_traj | c_pos | ground | root
        c_root_master.x | c_traj | hips | hips
        c_thigh_fk.{s} | c_root_master.x | thigh | thigh
        c_leg_fk.{s} | c_thigh_fk.{s} | knee | shin
        c_foot_fk.{s} | c_leg_fk.{s} | ankle | foot
        c_toes_fk.{s} | c_foot_fk.{s} | ball | toe
        c_foot_ik.{s} | c_traj | ankle
        c_spine_01.x | c_root_master.x | spine1 | spine
        c_spine_02.x | c_spine_01.x | spine3 | spine
        c_neck.x | c_spine_02.x | neck | neck
        c_head.x | c_neck.x | head | head
        c_shoulder.{s} | c_spine_02.x | collar | shoulder
        c_arm_fk.{s} | c_shoulder.{s} | shoulder | upper_arm
        c_forearm_fk.{s} | c_arm_fk.{s} | elbow | forearm
        c_hand_fk.{s} | c_forearm_fk.{s} | wrist | hand
        c_hand_ik.{s} | c_traj | wrist
        """,
    "xsens": """
        Hips | | hips | hips
        Chest | Hips | spine1 | spine
        Chest2 | Chest | spine2 | spine
        Chest4 | Chest2 | spine3 | spine
        Neck | Chest4 | neck | neck
        Head | Neck | head | head
        {Side}Collar | Chest4 | collar | shoulder
        {Side}Shoulder | {Side}Collar | shoulder | upper_arm
        {Side}Elbow | {Side}Shoulder | elbow | forearm
        {Side}Wrist | {Side}Elbow | wrist | hand
        {Side}Hip | Hips | thigh | thigh
        {Side}Knee | {Side}Hip | knee | shin
        {Side}Ankle | {Side}Knee | ankle | foot
        {Side}Toe | {Side}Ankle | ball | toe
        """,
    "axis neuron": """
        Hips | | hips | hips
        {Side}UpLeg | Hips | thigh | thigh
        {Side}Leg | {Side}UpLeg | knee | shin
        {Side}Foot | {Side}Leg | ankle | foot
        Spine | Hips | spine1 | spine
        Spine1 | Spine | spine2 | spine
        Spine2 | Spine1 | spine3 | spine
        Neck | Spine2 | neck | neck
        Head | Neck | head | head
        {Side}Shoulder | Spine2 | collar | shoulder
        {Side}Arm | {Side}Shoulder | shoulder | upper_arm
        {Side}ForeArm | {Side}Arm | elbow | forearm
        {Side}Hand | {Side}ForeArm | wrist | hand
        {Side}InHandIndex | {Side}Hand | palm
        {Side}HandIndex1 | {Side}InHandIndex | index0 | index
        """,
    "rokoko": """
        Hips | | hips | hips
        {Side}Thigh | Hips | thigh | thigh
        {Side}Shin | {Side}Thigh | knee | shin
        {Side}Foot | {Side}Shin | ankle | foot
        {Side}Toe | {Side}Foot | ball | toe
        Spine1 | Hips | spine1 | spine
        Spine2 | Spine1 | spine2 | spine
        Spine4 | Spine2 | spine3 | spine
        Neck | Spine4 | neck | neck
        Head | Neck | head | head
        {Side}Shoulder | Spine4 | collar | shoulder
        {Side}Arm | {Side}Shoulder | shoulder | upper_arm
        {Side}ForeArm | {Side}Arm | elbow | forearm
        {Side}Hand | {Side}ForeArm | wrist | hand
        """,
    "layers of a control rig": """
        ROOT | | ground | root
        MSTR-Torso | ROOT | hips | hips
        FK-Hips | MSTR-Torso | hips
        ORG-Hips | FK-Hips | hips
        DEF-Hips | ORG-Hips | hips
        FK-Spine | MSTR-Torso | spine1 | spine
        DEF-Spine | FK-Spine | spine1
        FK-Chest | FK-Spine | spine3 | spine
        DEF-Chest | FK-Chest | spine3
        FK-Neck | FK-Chest | neck | neck
        DEF-Neck | FK-Neck | neck
        FK-Head | FK-Neck | head
        DEF-Head | FK-Head | head | head
        FK-Clavicle.{S} | FK-Chest | collar
        DEF-Clavicle.{S} | FK-Clavicle.{S} | collar | shoulder
        FK-UpperArm.{S} | FK-Clavicle.{S} | shoulder
        ORG-UpperArm.{S} | FK-Clavicle.{S} | shoulder
        DEF-UpperArm1.{S} | ORG-UpperArm.{S} | shoulder | upper_arm
        DEF-UpperArm2.{S} | ORG-UpperArm.{S} | armtwist
        ORG-Forearm.{S} | ORG-UpperArm.{S} | elbow
        DEF-Forearm1.{S} | ORG-Forearm.{S} | elbow | forearm
        ORG-Wrist.{S} | ORG-Forearm.{S} | wrist
        DEF-Wrist.{S} | ORG-Wrist.{S} | wrist | hand
        IK-Wrist.{S} | ROOT | wrist
        ORG-Thigh.{S} | FK-Hips | thigh
        DEF-Thigh1.{S} | ORG-Thigh.{S} | thigh | thigh
        DEF-Thigh2.{S} | ORG-Thigh.{S} | thightwist
        ORG-Knee.{S} | ORG-Thigh.{S} | knee
        DEF-Knee1.{S} | ORG-Knee.{S} | knee | shin
        ORG-Foot.{S} | ORG-Knee.{S} | ankle
        DEF-Foot.{S} | ORG-Foot.{S} | ankle | foot
        IK-Foot.{S} | ROOT | ankle
        """,
    "deforming bones side by side on the root": """
        ROOT | | ground | root
        FK-Hips | ROOT | hips
        FK-Spine | FK-Hips | spine1
        DEF-Hips | ROOT | hips | hips
        DEF-Spine | ROOT | spine1 | spine
        DEF-Chest | ROOT | spine3 | spine
        DEF-Neck | ROOT | neck | neck
        DEF-Head | ROOT | head | head
        DEF-Clavicle.{S} | ROOT | collar | shoulder
        DEF-UpperArm.{S} | ROOT | shoulder | upper_arm
        DEF-Forearm.{S} | ROOT | elbow | forearm
        DEF-Wrist.{S} | ROOT | wrist | hand
        DEF-Thigh.{S} | ROOT | thigh | thigh
        DEF-Knee.{S} | ROOT | knee | shin
        DEF-Foot.{S} | ROOT | ankle | foot
        """,
    "finnish, hips and spine side by side": """
        juuri | | hips | hips
        lantio | juuri | hips
        vatsa | juuri | spine1 | spine
        rinta | vatsa | spine3 | spine
        kaula | rinta | neck | neck
        pää | kaula | head | head
        päälaki | pää | top
        olka{S} | rinta | collar | shoulder
        käsivarsi{S} | olka{S} | shoulder | upper_arm
        kyynärvarsi{S} | käsivarsi{S} | elbow | forearm
        ranne{S} | kyynärvarsi{S} | wrist | hand
        reisi{S} | lantio | thigh | thigh
        sääri{S} | reisi{S} | knee | shin
        nilkka{S} | sääri{S} | ankle | foot
        varpaat{S} | nilkka{S} | ball | toe
        """,
    "german": """
        Wurzel | | ground | root
        Becken | Wurzel | hips | hips
        Wirbelsäule1 | Becken | spine1 | spine
        Wirbelsäule2 | Wirbelsäule1 | spine2 | spine
        Brust | Wirbelsäule2 | spine3 | spine
        Hals | Brust | neck | neck
        Kopf | Hals | head | head
        Schlüsselbein_{S} | Brust | collar | shoulder
        Oberarm_{S} | Schlüsselbein_{S} | shoulder | upper_arm
        OberarmDrehung_{S} | Oberarm_{S} | armtwist
        Unterarm_{S} | Oberarm_{S} | elbow | forearm
        UnterarmDrehung_{S} | Unterarm_{S} | foretwist
        Hand_{S} | Unterarm_{S} | wrist | hand
        Daumen1_{S} | Hand_{S} | thumb0 | thumb
        Zeigefinger1_{S} | Hand_{S} | index0 | index
        Mittelfinger1_{S} | Hand_{S} | middle0 | middle
        Ringfinger1_{S} | Hand_{S} | ring0 | ring
        Kleinfinger1_{S} | Hand_{S} | pinky0 | pinky
        Oberschenkel_{S} | Becken | thigh | thigh
        Unterschenkel_{S} | Oberschenkel_{S} | knee | shin
        Fuß_{S} | Unterschenkel_{S} | ankle | foot
        Zehen_{S} | Fuß_{S} | ball | toe
        """,
    "spanish": """
        Raíz |  | ground | root
        Cadera | Raíz | hips | hips
        Columna_1 | Cadera | spine1 | spine
        Pecho | Columna_1 | spine3 | spine
        Cuello | Pecho | neck | neck
        Cabeza | Cuello | head | head
        Clavícula_{es} | Pecho | collar | shoulder
        Brazo_{es} | Clavícula_{es} | shoulder | upper_arm
        Giro_Brazo_{es} | Brazo_{es} | armtwist
        Antebrazo_{es} | Brazo_{es} | elbow | forearm
        Mano_{es} | Antebrazo_{es} | wrist | hand
        Índice_1_{es} | Mano_{es} | index0 | index
        Pulgar_1_{es} | Mano_{es} | thumb0 | thumb
        Muslo_{es} | Cadera | thigh | thigh
        Pantorrilla_{es} | Muslo_{es} | knee | shin
        Pie_{es} | Pantorrilla_{es} | ankle | foot
        Dedos_Pie_{es} | Pie_{es} | ball | toe
        """,
    "french": """
        racine |  | ground | root
        bassin | racine | hips | hips
        colonne.1 | bassin | spine1 | spine
        poitrine | colonne.1 | spine3 | spine
        cou | poitrine | neck | neck
        tête | cou | head | head
        clavicule.{fr} | poitrine | collar | shoulder
        bras.{fr} | clavicule.{fr} | shoulder | upper_arm
        avant_bras.{fr} | bras.{fr} | elbow | forearm
        main.{fr} | avant_bras.{fr} | wrist | hand
        index.1.{fr} | main.{fr} | index0 | index
        pouce.1.{fr} | main.{fr} | thumb0 | thumb
        cuisse.{fr} | bassin | thigh | thigh
        jambe.{fr} | cuisse.{fr} | knee | shin
        pied.{fr} | jambe.{fr} | ankle | foot
        orteils.{fr} | pied.{fr} | ball | toe
        """,
    "italian": """
        radice |  | ground | root
        bacino | radice | hips | hips
        colonna1 | bacino | spine1 | spine
        petto | colonna1 | spine3 | spine
        collo | petto | neck | neck
        testa | collo | head | head
        clavicola_{it} | petto | collar | shoulder
        braccio_{it} | clavicola_{it} | shoulder | upper_arm
        avambraccio_{it} | braccio_{it} | elbow | forearm
        mano_{it} | avambraccio_{it} | wrist | hand
        coscia_{it} | bacino | thigh | thigh
        gamba_{it} | coscia_{it} | knee | shin
        piede_{it} | gamba_{it} | ankle | foot
        """,
    "portuguese": """
        raiz |  | ground | root
        quadril | raiz | hips | hips
        coluna | quadril | spine1 | spine
        peito | coluna | spine3 | spine
        pescoço | peito | neck | neck
        cabeça | pescoço | head | head
        braço.{s} | peito | shoulder | upper_arm
        antebraço.{s} | braço.{s} | elbow | forearm
        mão.{s} | antebraço.{s} | wrist | hand
        coxa.{s} | quadril | thigh | thigh
        canela.{s} | coxa.{s} | knee | shin
        pé.{s} | canela.{s} | ankle | foot
        """,
    "russian": """
        Корень |  | ground | root
        Таз | Корень | hips | hips
        Поясница | Таз | spine1 | spine
        Грудь | Поясница | spine3 | spine
        Шея | Грудь | neck | neck
        Голова | Шея | head | head
        Ключица_{ru} | Грудь | collar | shoulder
        Плечо_{ru} | Ключица_{ru} | shoulder | upper_arm
        Предплечье_{ru} | Плечо_{ru} | elbow | forearm
        Кисть_{ru} | Предплечье_{ru} | wrist | hand
        УказательныйПалец1_{ru} | Кисть_{ru} | index0 | index
        БольшойПалец1_{ru} | Кисть_{ru} | thumb0 | thumb
        Бедро_{ru} | Таз | thigh | thigh
        Голень_{ru} | Бедро_{ru} | knee | shin
        Стопа_{ru} | Голень_{ru} | ankle | foot
        ПальцыСтопы_{ru} | Стопа_{ru} | ball | toe
        """,
    "chinese": """
        全 |  | ground | root
        骨盆 | 全 | hips | hips
        脊椎1 | 骨盆 | spine1 | spine
        脊椎2 | 脊椎1 | spine3 | spine
        脖子 | 脊椎2 | neck | neck
        头 | 脖子 | head | head
        {jp}锁骨 | 脊椎2 | collar | shoulder
        {jp}上臂 | {jp}锁骨 | shoulder | upper_arm
        {jp}前臂 | {jp}上臂 | elbow | forearm
        {jp}手 | {jp}前臂 | wrist | hand
        {jp}大腿 | 骨盆 | thigh | thigh
        {jp}小腿 | {jp}大腿 | knee | shin
        {jp}脚 | {jp}小腿 | ankle | foot
        {jp}脚趾 | {jp}脚 | ball | toe
        """,
    "a prefix on most bones, helpers of other prefixes": """
        SKEL_ROOT | | hips | hips
        SKEL_Pelvis | SKEL_ROOT | hips
        SKEL_{S}_Thigh | SKEL_Pelvis | thigh | thigh
        RB_{S}_ThighRoll | SKEL_{S}_Thigh | thightwist
        SKEL_{S}_Calf | SKEL_{S}_Thigh | knee | shin
        MH_{S}_Knee | SKEL_{S}_Calf | knee
        SKEL_{S}_Foot | SKEL_{S}_Calf | ankle | foot
        PH_{S}_Foot | SKEL_{S}_Foot | ankle
        SKEL_{S}_Toe0 | SKEL_{S}_Foot | ball | toe
        SKEL_Spine_Root | SKEL_ROOT | spine1
        SKEL_Spine0 | SKEL_Spine_Root | spine1 | spine
        SKEL_Spine1 | SKEL_Spine0 | spine2 | spine
        SKEL_Spine3 | SKEL_Spine1 | spine3 | spine
        SKEL_Neck_1 | SKEL_Spine3 | neck | neck
        SKEL_Head | SKEL_Neck_1 | head | head
        SKEL_{S}_Clavicle | SKEL_Spine3 | collar | shoulder
        SKEL_{S}_UpperArm | SKEL_{S}_Clavicle | shoulder | upper_arm
        RB_{S}_ArmRoll | SKEL_{S}_UpperArm | armtwist
        SKEL_{S}_Forearm | SKEL_{S}_UpperArm | elbow | forearm
        SKEL_{S}_Hand | SKEL_{S}_Forearm | wrist | hand
        IK_{S}_Hand | SKEL_{S}_Hand | wrist
        SKEL_{S}_Finger00 | SKEL_{S}_Hand | thumb0 | thumb
        SKEL_{S}_Finger10 | SKEL_{S}_Hand | index0 | index
        """,
    "remarks in brackets": """
        NPC Root [Root] | | ground
        NPC COM [COM ] | NPC Root [Root] | hips | hips
        NPC Pelvis [Pelv] | NPC COM [COM ] | hips
        NPC {S} Thigh [{S}Thg] | NPC Pelvis [Pelv] | thigh | thigh
        NPC {S} Calf [{S}Clf] | NPC {S} Thigh [{S}Thg] | knee | shin
        NPC {S} Foot [{S}ft ] | NPC {S} Calf [{S}Clf] | ankle | foot
        NPC {S} Toe0 [{S}Toe] | NPC {S} Foot [{S}ft ] | ball | toe
        NPC Spine [Spn0] | NPC COM [COM ] | spine1 | spine
        NPC Spine1 [Spn1] | NPC Spine [Spn0] | spine3 | spine
        NPC Neck [Neck] | NPC Spine1 [Spn1] | neck | neck
        NPC Head [Head] | NPC Neck [Neck] | head | head
        NPC {S} Clavicle [{S}Clv] | NPC Spine1 [Spn1] | collar | shoulder
        NPC {S} UpperArm [{S}Uar] | NPC {S} Clavicle [{S}Clv] | shoulder | upper_arm
        NPC {S} Forearm [{S}Lar] | NPC {S} UpperArm [{S}Uar] | elbow | forearm
        NPC {S} Hand [{S}Hnd] | NPC {S} Forearm [{S}Lar] | wrist | hand
        NPC {S} Finger00 [{S}F00] | NPC {S} Hand [{S}Hnd] | thumb0 | thumb
        NPC {S} Finger10 [{S}F10] | NPC {S} Hand [{S}Hnd] | index0 | index
        """,
    "a word of the body on all bones": """
        Body_Pelvis | | hips | hips
        Body_Spine_Lower | Body_Pelvis | spine1 | spine
        Body_Spine_Upper | Body_Spine_Lower | spine3 | spine
        Body_Neck | Body_Spine_Upper | neck | neck
        Body_Head | Body_Neck | head | head
        Body_Arm_Upper_{Side} | Body_Spine_Upper | shoulder | upper_arm
        Body_Arm_Lower_{Side} | Body_Arm_Upper_{Side} | elbow | forearm
        Body_Hand_{Side} | Body_Arm_Lower_{Side} | wrist | hand
        Body_Leg_Upper_{Side} | Body_Pelvis | thigh | thigh
        Body_Leg_Lower_{Side} | Body_Leg_Upper_{Side} | knee | shin
        Body_Foot_{Side} | Body_Leg_Lower_{Side} | ankle | foot
        """,
    "limbs of numbered bones, fists": """
        Hip | | hips | hips
        Spine1 | Hip | spine1 | spine
        Spine2 | Spine1 | spine3 | spine
        Head | Spine2 | head | head
        Arm1.{S} | Spine2 | shoulder | upper_arm
        Arm2.{S} | Arm1.{S} | elbow | forearm
        Fist.{S} | Arm2.{S} | wrist | hand
        Leg1.{S} | Hip | thigh | thigh
        Leg2.{S} | Leg1.{S} | knee | shin
        Foot.{S} | Leg2.{S} | ankle | foot
        """,
    "stretched bones that auto-rig pro exports": """
        root.x | | hips | hips
        spine_01.x | root.x | spine1 | spine
        spine_02.x | spine_01.x | spine3 | spine
        neck.x | spine_02.x | neck | neck
        head.x | neck.x | head | head
        jawbone.x | head.x | face
        shoulder.{s} | spine_02.x | collar | shoulder
        arm_stretch.{s} | shoulder.{s} | shoulder | upper_arm
        arm_twist.{s} | arm_stretch.{s} | shoulder
        forearm_stretch.{s} | arm_stretch.{s} | elbow | forearm
        forearm_twist.{s} | forearm_stretch.{s} | foretwist
        hand.{s} | forearm_stretch.{s} | wrist | hand
        thigh_stretch.{s} | root.x | thigh | thigh
        thigh_twist.{s} | thigh_stretch.{s} | thigh
        leg_stretch.{s} | thigh_stretch.{s} | knee | shin
        leg_twist.{s} | leg_stretch.{s} | shintwist
        foot.{s} | leg_stretch.{s} | ankle | foot
        toes_01.{s} | foot.{s} | ball | toe
        """,
    "mikumikudance in blender": """
        全ての親 | | ground
        腰 | 全ての親 | hips | hips
        下半身 | 腰 | spine1
        上半身 | 腰 | spine1 | spine
        首 | 上半身 | neck | neck
        頭 | 首 | head | head
        肩.{S} | 上半身 | collar | shoulder
        腕.{S} | 肩.{S} | shoulder | upper_arm
        腕捩.{S} | 腕.{S} | armtwist
        ひじ.{S} | 腕捩.{S} | elbow | forearm
        手首.{S} | ひじ.{S} | wrist | hand
        親指０.{S} | 手首.{S} | thumb0 | thumb
        親指１.{S} | 親指０.{S} | thumb1 | thumb
        人指１.{S} | 手首.{S} | index0 | index
        人指２.{S} | 人指１.{S} | index1 | index
        小指１.{S} | 手首.{S} | pinky0 | pinky
        足.{S} | 下半身 | thigh | thigh
        ひざ.{S} | 足.{S} | knee | shin
        足首.{S} | ひざ.{S} | ankle | foot
        つま先.{S} | 足首.{S} | ball | toe
        足ＩＫ.{S} | 全ての親 | ankle
        足IK親.{S} | 全ての親 | ankle
        """,
    "anatomical words behind those of limbs": """
        COG | | hips | hips
        hips | COG | hips
        spine_0 | COG | spine1 | spine
        spine_1 | spine_0 | spine3 | spine
        neck_0 | spine_1 | neck | neck
        head | neck_0 | head | head
        {s}_arm_clavicle | spine_1 | collar | shoulder
        {s}_arm_humerus | {s}_arm_clavicle | shoulder | upper_arm
        {s}_arm_radius | {s}_arm_humerus | elbow | forearm
        {s}_arm_wrist | {s}_arm_radius | wrist | hand
        {s}_leg_femur | hips | thigh | thigh
        {s}_leg_tibia | {s}_leg_femur | knee | shin
        {s}_leg_ankle | {s}_leg_tibia | ankle | foot
        {s}_leg_ball | {s}_leg_ankle | ball | toe
        """,
    "a second pair of arms, lower on the trunk": """
        Hips | | hips | hips
        Spine | Hips | spine1 | spine
        UpperArm2.{S} | Spine | spine2
        LowerArm2.{S} | UpperArm2.{S} | elbow
        Hand2.{S} | LowerArm2.{S} | wrist
        Chest | Spine | spine3 | spine
        Head | Chest | head | head
        UpperArm.{S} | Chest | shoulder | upper_arm
        LowerArm.{S} | UpperArm.{S} | elbow | forearm
        Hand.{S} | LowerArm.{S} | wrist | hand
        UpperLeg.{S} | Hips | thigh | thigh
        LowerLeg.{S} | UpperLeg.{S} | knee | shin
        Foot.{S} | LowerLeg.{S} | ankle | foot
        """,
    "a torso below the centre of gravity that carries hips and spine": """
        root | | ground | root
        COG | root | hips
        torso | COG | hips
        hips | torso | hips | hips
        spine | hips | spine1 | spine
        chest | spine | spine3 | spine
        shoulder.{S} | chest | collar | shoulder
        upper_arm.{S} | shoulder.{S} | shoulder | upper_arm
        forearm.{S} | upper_arm.{S} | elbow | forearm
        hand.{S} | forearm.{S} | wrist | hand
        neck | chest | neck | neck
        head | neck | head | head
        thigh.{S} | hips | thigh | thigh
        shin.{S} | thigh.{S} | knee | shin
        foot.{S} | shin.{S} | ankle | foot
        """,
    "fallout 4": """
        Root | | ground | root
        COM | Root | hips | hips
        Pelvis | COM | hips
        {S}Leg_Thigh | Pelvis | thigh | thigh
        {S}Leg_Calf | {S}Leg_Thigh | knee | shin
        {S}Leg_Foot | {S}Leg_Calf | ankle | foot
        {S}Leg_Toe1 | {S}Leg_Foot | ball | toe
        SPINE1 | COM | spine1 | spine
        SPINE2 | SPINE1 | spine2 | spine
        Chest | SPINE2 | spine3 | spine
        {S}Arm_Collarbone | Chest | collar | shoulder
        {S}Arm_UpperArm | {S}Arm_Collarbone | shoulder | upper_arm
        {S}Arm_ForeArm1 | {S}Arm_UpperArm | elbow | forearm
        {S}Arm_Hand | {S}Arm_ForeArm1 | wrist | hand
        Neck | Chest | neck | neck
        HEAD | Neck | head | head
        """,
    "catparent": """
        CATRigHub001 | | ground
        CATRigPelvis | CATRigHub001 | hips | hips
        CATRigSpine1 | CATRigPelvis | spine1 | spine
        CATRigRibcage | CATRigSpine1 | spine3 | spine
        CATRigNeck1 | CATRigRibcage | neck | neck
        CATRigHead | CATRigNeck1 | head | head
        CATRig{S}ArmCollarbone | CATRigRibcage | collar | shoulder
        CATRig{S}Arm1 | CATRig{S}ArmCollarbone | shoulder | upper_arm
        CATRig{S}Arm2 | CATRig{S}Arm1 | elbow | forearm
        CATRig{S}ArmPalm | CATRig{S}Arm2 | wrist | hand
        CATRig{S}ArmDigit11 | CATRig{S}ArmPalm | thumb0 | thumb
        CATRig{S}ArmDigit12 | CATRig{S}ArmDigit11 | thumb1 | thumb
        CATRig{S}ArmDigit21 | CATRig{S}ArmPalm | index0 | index
        CATRig{S}ArmDigit22 | CATRig{S}ArmDigit21 | index1 | index
        CATRig{S}Leg1 | CATRigPelvis | thigh | thigh
        CATRig{S}Leg2 | CATRig{S}Leg1 | knee | shin
        CATRig{S}LegAnkle | CATRig{S}Leg2 | ankle | foot
        CATRig{S}LegDigit11 | CATRig{S}LegAnkle | ball
        """,
    "optitrack": """
        Skeleton 001:Hip | | hips | hips
        Skeleton 001:Ab | Skeleton 001:Hip | spine1 | spine
        Skeleton 001:Chest | Skeleton 001:Ab | spine3 | spine
        Skeleton 001:Neck | Skeleton 001:Chest | neck | neck
        Skeleton 001:Head | Skeleton 001:Neck | head | head
        Skeleton 001:{S}Shoulder | Skeleton 001:Chest | collar | shoulder
        Skeleton 001:{S}UArm | Skeleton 001:{S}Shoulder | shoulder | upper_arm
        Skeleton 001:{S}FArm | Skeleton 001:{S}UArm | elbow | forearm
        Skeleton 001:{S}Hand | Skeleton 001:{S}FArm | wrist | hand
        Skeleton 001:{S}Thigh | Skeleton 001:Hip | thigh | thigh
        Skeleton 001:{S}Shin | Skeleton 001:{S}Thigh | knee | shin
        Skeleton 001:{S}Foot | Skeleton 001:{S}Shin | ankle | foot
        Skeleton 001:{S}Toe | Skeleton 001:{S}Foot | ball | toe
        """,
    "bones of volumes beside those of joints": """
        mPelvis | | hips | hips
        PELVIS | mPelvis | hips
        mTorso | mPelvis | spine1 | spine
        BELLY | mTorso | spine1
        mChest | mTorso | spine3 | spine
        CHEST | mChest | spine3
        mNeck | mChest | neck | neck
        NECK | mNeck | neck
        mHead | mNeck | head | head
        HEAD | mHead | head
        mCollar{Side} | mChest | collar | shoulder
        {S}_CLAVICLE | mCollar{Side} | collar
        mShoulder{Side} | mCollar{Side} | shoulder | upper_arm
        {S}_UPPER_ARM | mShoulder{Side} | shoulder
        mElbow{Side} | mShoulder{Side} | elbow | forearm
        {S}_LOWER_ARM | mElbow{Side} | elbow
        mWrist{Side} | mElbow{Side} | wrist | hand
        {S}_HAND | mWrist{Side} | wrist
        mHip{Side} | mPelvis | thigh | thigh
        {S}_UPPER_LEG | mHip{Side} | thigh
        mKnee{Side} | mHip{Side} | knee | shin
        {S}_LOWER_LEG | mKnee{Side} | knee
        mAnkle{Side} | mKnee{Side} | ankle | foot
        {S}_FOOT | mAnkle{Side} | ankle
        mFoot{Side} | mAnkle{Side} | ball | toe
        mToe{Side} | mFoot{Side} | tiptoe
        """,
    "joints of limbs, one finger for three": """
        Root | | ground | root
        Hips | Root | hips | hips
        Spine_01 | Hips | spine1 | spine
        Spine_02 | Spine_01 | spine3 | spine
        Neck | Spine_02 | neck | neck
        Head | Neck | head | head
        Clavicle_{S} | Spine_02 | collar | shoulder
        Shoulder_{S} | Clavicle_{S} | shoulder | upper_arm
        Elbow_{S} | Shoulder_{S} | elbow | forearm
        Hand_{S} | Elbow_{S} | wrist | hand
        Thumb_01_{S} | Hand_{S} | thumb0 | thumb
        IndexFinger_01_{S} | Hand_{S} | index0 | index
        Finger_01_{S} | Hand_{S} | middle0 | middle
        Finger_02_{S} | Finger_01_{S} | middle1 | middle
        UpperLeg_{S} | Hips | thigh | thigh
        LowerLeg_{S} | UpperLeg_{S} | knee | shin
        Ankle_{S} | LowerLeg_{S} | ankle | foot
        Ball_{S} | Ankle_{S} | ball | toe
        Toes_{S} | Ball_{S} | tiptoe
        """,
    "source 2": """
        pelvis | | hips | hips
        spine_0 | pelvis | spine1 | spine
        spine_1 | spine_0 | spine3 | spine
        clavicle_{S} | spine_1 | collar | shoulder
        arm_upper_{S} | clavicle_{S} | shoulder | upper_arm
        arm_lower_{S} | arm_upper_{S} | elbow | forearm
        hand_{S} | arm_lower_{S} | wrist | hand
        finger_index_0_{S} | hand_{S} | index0 | index
        finger_index_1_{S} | finger_index_0_{S} | index1 | index
        leg_upper_{S} | pelvis | thigh | thigh
        leg_lower_{S} | leg_upper_{S} | knee | shin
        ankle_{S} | leg_lower_{S} | ankle | foot
        ball_{S} | ankle_{S} | ball | toe
        neck_0 | spine_1 | neck | neck
        head | neck_0 | head | head
        """,
    "letters number the bones of chains": """
        cn_pelvis_bnd | | hips | hips
        cn_spineA_bnd | cn_pelvis_bnd | spine1 | spine
        cn_spineB_bnd | cn_spineA_bnd | spine2 | spine
        cn_spineC_bnd | cn_spineB_bnd | spine3 | spine
        {f}_clav_bnd | cn_spineC_bnd | collar | shoulder
        {f}_uprArm_bnd | {f}_clav_bnd | shoulder | upper_arm
        {f}_lwrArm_bnd | {f}_uprArm_bnd | elbow | forearm
        {f}_wrist_bnd | {f}_lwrArm_bnd | wrist | hand
        {f}_indexA_bnd | {f}_wrist_bnd | index0 | index
        {f}_indexB_bnd | {f}_indexA_bnd | index1 | index
        {f}_upLeg_bnd | cn_pelvis_bnd | thigh | thigh
        {f}_loLeg_bnd | {f}_upLeg_bnd | knee | shin
        {f}_ankle_bnd | {f}_loLeg_bnd | ankle | foot
        cn_neckA_bnd | cn_spineC_bnd | neck | neck
        cn_neckB_bnd | cn_neckA_bnd | nape | neck
        cn_head_bnd | cn_neckB_bnd | head | head
        """,
    "small letters number the bones of chains": """
        hips | | hips | hips
        spine_a | hips | spine1 | spine
        spine_b | spine_a | spine2 | spine
        spine_c | spine_b | spine3 | spine
        collar.{S} | spine_c | collar | shoulder
        arm.{S} | collar.{S} | shoulder | upper_arm
        elbow.{S} | arm.{S} | elbow | forearm
        hand.{S} | elbow.{S} | wrist | hand
        thumb_a.{S} | hand.{S} | thumb0 | thumb
        thumb_b.{S} | thumb_a.{S} | thumb1 | thumb
        leg.{S} | hips | thigh | thigh
        knee.{S} | leg.{S} | knee | shin
        foot.{S} | knee.{S} | ankle | foot
        neck_a | spine_c | neck | neck
        neck_b | neck_a | nape | neck
        head | neck_b | head | head
        """,
    "joints named as in films, the head by a letter": """
        root_JNT | | ground | root
        C_pelvis_JNT | root_JNT | hips | hips
        C_spineA_JNT | C_pelvis_JNT | spine1 | spine
        C_spineB_JNT | C_spineA_JNT | spine2 | spine
        C_spineC_JNT | C_spineB_JNT | spine3 | spine
        {S}_clav_JNT | C_spineC_JNT | collar | shoulder
        {S}_shoulder_JNT | {S}_clav_JNT | shoulder | upper_arm
        {S}_elbow_JNT | {S}_shoulder_JNT | elbow | forearm
        {S}_wrist_JNT | {S}_elbow_JNT | wrist | hand
        {S}_hip_JNT | C_pelvis_JNT | thigh | thigh
        {S}_knee_JNT | {S}_hip_JNT | knee | shin
        {S}_ankle_JNT | {S}_knee_JNT | ankle | foot
        C_neckA_JNT | C_spineC_JNT | neck | neck
        C_headA_JNT | C_neckA_JNT | head | head
        """,
    "toes that are named like fingers": """
        Hips | | hips | hips
        Spine | Hips | spine1 | spine
        Spine1 | Spine | spine2 | spine
        {Side}Shoulder | Spine1 | collar | shoulder
        {Side}Arm | {Side}Shoulder | shoulder | upper_arm
        {Side}ForeArm | {Side}Arm | elbow | forearm
        {Side}Hand | {Side}ForeArm | wrist | hand
        {Side}HandIndex1 | {Side}Hand | index0 | index
        {Side}UpLeg | Hips | thigh | thigh
        {Side}Leg | {Side}UpLeg | knee | shin
        {Side}Foot | {Side}Leg | ankle | foot
        {Side}FootThumb1 | {Side}Foot | ball | toe
        {Side}FootThumb2 | {Side}FootThumb1 | tiptoe
        {Side}FootPinky1 | {Side}Foot | ball
        Neck | Spine1 | neck | neck
        Head | Neck | head | head
        """,
    "toes without a bone for all": """
        hip | | hips | hips
        abdomenLower | hip | spine1 | spine
        chestUpper | abdomenLower | spine2 | spine
        {s}Collar | chestUpper | collar | shoulder
        {s}ShldrBend | {s}Collar | shoulder | upper_arm
        {s}ForearmBend | {s}ShldrBend | elbow | forearm
        {s}Hand | {s}ForearmBend | wrist | hand
        {s}ThighBend | hip | thigh | thigh
        {s}Shin | {s}ThighBend | knee | shin
        {s}Foot | {s}Shin | ankle | foot
        {s}BigToe | {s}Foot | ball | toe
        {s}BigToe_2 | {s}BigToe | tiptoe
        {s}SmallToe1 | {s}Foot | ball
        {s}SmallToe4 | {s}Foot | ball
        neckLower | chestUpper | neck | neck
        head | neckLower | head | head
        """,
    "vrm 1.0 as blender marks sides": """
        hips | | hips | hips
        spine | hips | spine1 | spine
        upper_chest | spine | spine3 | spine
        neck | upper_chest | neck | neck
        head | neck | head | head
        shoulder.{S} | upper_chest | collar | shoulder
        upper_arm.{S} | shoulder.{S} | shoulder | upper_arm
        lower_arm.{S} | upper_arm.{S} | elbow | forearm
        hand.{S} | lower_arm.{S} | wrist | hand
        thumb.metacarpal.{S} | hand.{S} | thumb0 | thumb
        thumb.proximal.{S} | thumb.metacarpal.{S} | thumb1 | thumb
        index.metacarpal.{S} | hand.{S} | palm
        index.proximal.{S} | index.metacarpal.{S} | index0 | index
        index.intermediate.{S} | index.proximal.{S} | index1 | index
        little.proximal.{S} | hand.{S} | pinky0 | pinky
        upper_leg.{S} | hips | thigh | thigh
        lower_leg.{S} | upper_leg.{S} | knee | shin
        foot.{S} | lower_leg.{S} | ankle | foot
        toes.{S} | foot.{S} | ball | toe
        """,
}


def foreign_skeleton(kind: str, droop: float = 0.7) -> tuple[RestSkeleton, dict[str, tuple[str, ...]]]:
    """A skeleton without tails, and the roles of its bones; left is +X, it faces -Y."""
    at = _points(droop)
    names: list[str] = []
    parents: list[str] = []
    heads: list[np.ndarray] = []
    roles: dict[str, tuple[str, ...]] = {}
    for line in SKELETONS[kind].strip().splitlines():
        pattern, above, point, *role = (word.strip() for word in line.split("|"))
        for side, words in (("L", _LEFT), ("R", _RIGHT)) if "{" in pattern else (("", {}),):
            name = pattern.format(**words)
            names.append(name)
            parents.append(above.format(**words))
            heads.append(at[point] * ([-1.0, 1.0, 1.0] if side == "R" else 1.0))
            if role:
                key = f"{role[0]}.{side}" if side else role[0]
                roles[key] = (*roles.get(key, ()), name)
    order = [names.index(name) if name else -1 for name in parents]
    return RestSkeleton(tuple(names), tuple(order), np.array(heads), np.full((len(names), 3), np.nan)), roles
